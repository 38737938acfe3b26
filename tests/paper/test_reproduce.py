"""`solen project reproduce`: the paper's figures with marks and numbers, the same each time, finished ones kept."""

import json
import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from markupsafe import escape

from solen.cli import run_command
from solen.errors import SolenError
from solen.paper.records import chosen, letters_of
from solen.paper.reproduction import Reproduction
from solen.pipeline.project import paper
from solen.pipeline.project.reproduce import reproduce
from tests.report.test_html_page import Page

FEW = ("3A", "S1D", "S2")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("reproduction")
    reproduce(out=out, figures=FEW)
    return out


def numbers(out: Path) -> list[Any]:
    found = json.loads((out / "reproduction.json").read_text(encoding="utf-8"))
    return [one["comparisons"] for one in found["figures"]]


def again(out: Path, *figure: str) -> Reproduction:
    return reproduce(out=out, figures=figure or FEW).result


def test_letters_are_found_in_the_figures_that_hold_them() -> None:
    names = [one.name for one in paper.FIGURES]
    assert letters_of("3B-D") == {"3B", "3C", "3D"}
    assert chosen(names, ()) == tuple(names)
    assert chosen(names, ("3C",)) == ("3B-D",)
    assert chosen(names, ("3",)) == ("3A", "3B-D", "3E-G")
    assert chosen(names, ("3b-e", "s1")) == ("3B-D", "3E-G", "S1A", "S1B", "S1C", "S1D")
    assert chosen(names, ("2B", "S5D")) == ("2", "S5")
    for wrong in ("9", "1", "3Z", "lens", "S3"):
        with pytest.raises(SolenError, match=re.escape(wrong)):
            chosen(names, (wrong,))


def test_a_second_run_has_the_same_numbers_and_pictures(folder: Path, tmp_path: Path) -> None:
    reproduce(out=tmp_path, figures=FEW)
    assert numbers(tmp_path) == numbers(folder) != []
    for picture in (folder / "figures").iterdir():
        assert picture.read_bytes() == (tmp_path / "figures" / picture.name).read_bytes(), picture.name


def test_what_was_not_asked_for_is_no_failure(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "figures").mkdir()
    for path in (folder / "figures").glob("S2.*"):
        shutil.copy(path, tmp_path / "figures")
    assert run_command(["project", "reproduce", "--out", str(tmp_path), "--figure", "S2"]) == 0
    first, *rest = capsys.readouterr().out.splitlines()
    assert first == "1 figure of the paper: 0 made now, 1 kept"
    assert [line for line in rest if line.startswith("not requested")]
    assert not [line for line in rest if line.startswith("not made")]


def test_finished_figures_are_kept_and_changed_ones_made_again(folder: Path) -> None:
    before = (folder / "figures" / "S1D.svg").read_bytes()
    assert not any(one.made for one in again(folder).figures)
    (folder / "figures" / "S1D.svg").write_bytes(b"changed")
    assert [one.name for one in again(folder).figures if one.made] == ["S1D"]
    assert (folder / "figures" / "S1D.svg").read_bytes() == before


def test_another_solen_makes_all_of_them_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("solen.paper.records.code_sha256", lambda: "another")
    found = again(folder, "S2")
    assert [(one.name, one.made) for one in found.figures] == [("S2", True)]
    monkeypatch.undo()
    assert len(again(folder).figures) == len(FEW)


def test_what_was_finished_before_an_interruption_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: Path) -> paper.Made:
        raise KeyboardInterrupt

    broken = tuple(replace(one, make=interrupted) if one.name == "S2" else one for one in paper.FIGURES)
    monkeypatch.setattr(paper, "FIGURES", broken)
    with pytest.raises(KeyboardInterrupt):
        reproduce(out=tmp_path, figures=("3A", "S2"))
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {"3A.svg", "3A.json"}
    monkeypatch.undo()
    assert [one.name for one in again(tmp_path, "3A", "S2").figures if one.made] == ["S2"]


def test_the_page_says_for_each_what_agrees_and_what_is_simulated(folder: Path) -> None:
    found, text = again(folder), (folder / "reproduction.html").read_text(encoding="utf-8")
    page = Page(text)
    assert page.texts["h2"] == ["Figure 3A", "Figure S1D", "Figure S2"]
    assert page.tags["svg"] == 3
    assert len(re.findall(r'role="img" aria-label="[^"]{30,}"', text)) == 3
    assert "SIMULATED: " in text
    assert "seed 1" in text
    for one in found.figures:
        for row in one.comparisons:
            assert str(escape(row.why)) in text
            assert text.count(f">{row.verdict}<") >= 1
        assert all(str(escape(command)) in text for command in one.commands)
    assert all(target.startswith("#") or target == "data:," for _, target in page.loads)
    assert (found.agrees, found.differs, found.cannot_be_checked) == (12, 0, 1)
    assert set(found.not_made) == {one.name for one in paper.FIGURES} - set(FEW)
    assert "Not made yet: 2, 3B-D" in text


@pytest.mark.evidence
def test_all_figures_twice(tmp_path: Path) -> None:
    one, other = (tmp_path / name for name in ("one", "other"))
    found = reproduce(out=one).result
    reproduce(out=other)
    assert found.not_made == ()
    assert numbers(one) == numbers(other)
    for picture in (one / "figures").iterdir():
        assert picture.read_bytes() == (other / "figures" / picture.name).read_bytes(), picture.name
    by_key = {row.key: row for figure in found.figures for row in figure.comparisons}
    assert by_key["absorbance"].verdict == by_key["dispersion"].verdict == "differs"
    assert by_key["slab"].verdict == by_key["to-right"].verdict == by_key["in-space"].verdict == "agrees"
    assert by_key["control-measured"].verdict == "differs"
    assert {row.verdict for key, row in by_key.items() if key in {"pillar", "hole", "transmittance"}} == {
        "cannot be checked"
    }


@pytest.mark.evidence
def test_each_figure_is_made_by_its_commands_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reproduce(out=tmp_path)
    monkeypatch.chdir(tmp_path)
    for command in dict.fromkeys(command for one in paper.FIGURES for command in one.commands):
        words = shlex.split(command, comments=True)[1:]
        arguments = [
            name for word in words for name in (sorted(map(str, Path().glob(word))) if "*" in word else [word])
        ]
        assert run_command([*arguments, "--quiet"]) == 0, command


def test_the_page_of_the_docs_names_each_figure_and_its_commands() -> None:
    text = (Path(__file__).resolve().parents[2] / "docs" / "paper-figures.md").read_text(encoding="utf-8")
    assert [command for one in paper.FIGURES for command in one.commands if command not in text] == []
    table = {
        letter
        for row in re.findall(r"^\| ([S\d][\w–]*) ", text, re.MULTILINE)
        for letter in letters_of(row.replace("–", "-"))
    }
    assert table == {letter for one in paper.FIGURES for letter in letters_of(one.name)} - {"2", "S2", "S4", "S5"} | {
        "2A", "2B", "2C", "S2", "S4", "S5A", "S5B", "S5C", "S5D"
    }  # fmt: skip
