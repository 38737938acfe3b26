"""`solen project reproduce`: reproducible figures, with comparisons and marks; finished figures are kept."""

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
from solen.paper.records import letters_of, select_figures
from solen.paper.reproduction import Reproduction
from solen.pipeline.project import paper
from solen.pipeline.project.reproduce import reproduce
from tests.report.test_html_page import Page

SELECTED = ("3A", "S1D", "S2")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("reproduction")
    reproduce(out=out, figures=SELECTED)
    return out


def numbers(out: Path) -> list[Any]:
    result = json.loads((out / "reproduction.json").read_text(encoding="utf-8"))
    return [figure["comparisons"] for figure in result["figures"]]


def reproduce_again(out: Path, *figure: str) -> Reproduction:
    return reproduce(out=out, figures=figure or SELECTED).result


def test_selects_figures_that_contain_panels() -> None:
    names = [figure.name for figure in paper.FIGURES]
    assert letters_of("3B-D") == {"3B", "3C", "3D"}
    assert select_figures(names, ()) == tuple(names)
    assert select_figures(names, ("3C",)) == ("3B-D",)
    assert select_figures(names, ("3",)) == ("3A", "3B-D", "3E-G")
    assert select_figures(names, ("3b-e", "s1")) == ("3B-D", "3E-G", "S1A", "S1B", "S1C", "S1D")
    assert select_figures(names, ("2B", "S5D")) == ("2", "S5")
    for wrong in ("9", "1", "3Z", "lens", "S3"):
        with pytest.raises(SolenError, match=re.escape(wrong)):
            select_figures(names, (wrong,))


def test_second_run_gives_identical_numbers_and_images(folder: Path, tmp_path: Path) -> None:
    reproduce(out=tmp_path, figures=SELECTED)
    assert numbers(tmp_path) == numbers(folder) != []
    for picture in (folder / "figures").iterdir():
        assert picture.read_bytes() == (tmp_path / "figures" / picture.name).read_bytes(), picture.name


def test_figures_that_were_not_requested_are_listed(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "figures").mkdir()
    for path in (folder / "figures").glob("S2.*"):
        shutil.copy(path, tmp_path / "figures")
    assert run_command(["project", "reproduce", "--out", str(tmp_path), "--figure", "S2"]) == 0
    first, *rest = capsys.readouterr().out.splitlines()
    assert first == "1 figure of the paper: 0 made now, 1 kept"
    assert [line for line in rest if line.startswith("not requested")]
    assert not [line for line in rest if line.startswith("not made")]


def test_keeps_finished_figures_and_repeats_changed_ones(folder: Path) -> None:
    before = (folder / "figures" / "S1D.svg").read_bytes()
    assert not any(figure.made for figure in reproduce_again(folder).figures)
    (folder / "figures" / "S1D.svg").write_bytes(b"changed")
    assert [figure.name for figure in reproduce_again(folder).figures if figure.made] == ["S1D"]
    assert (folder / "figures" / "S1D.svg").read_bytes() == before


def test_other_version_repeats_all_figures(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("solen.paper.records.code_sha256", lambda: "another")
    result = reproduce_again(folder, "S2")
    assert [(figure.name, figure.made) for figure in result.figures] == [("S2", True)]
    monkeypatch.undo()
    assert len(reproduce_again(folder).figures) == len(SELECTED)


def test_keeps_figures_finished_before_interruption(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: Path) -> paper.Made:
        raise KeyboardInterrupt

    broken = tuple(replace(figure, make=interrupted) if figure.name == "S2" else figure for figure in paper.FIGURES)
    monkeypatch.setattr(paper, "FIGURES", broken)
    with pytest.raises(KeyboardInterrupt):
        reproduce(out=tmp_path, figures=("3A", "S2"))
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {"3A.svg", "3A.json"}
    monkeypatch.undo()
    assert [figure.name for figure in reproduce_again(tmp_path, "3A", "S2").figures if figure.made] == ["S2"]


def test_page_contains_verdicts_reasons_and_marks(folder: Path) -> None:
    result, text = reproduce_again(folder), (folder / "reproduction.html").read_text(encoding="utf-8")
    page = Page(text)
    assert page.texts["h2"] == ["Figure 3A", "Figure S1D", "Figure S2"]
    assert page.tags["svg"] == 3
    assert len(re.findall(r'role="img" aria-label="[^"]{30,}"', text)) == 3
    assert "SIMULATED: " in text
    assert "seed 1" in text
    for figure in result.figures:
        for row in figure.comparisons:
            assert str(escape(row.why)) in text
            assert text.count(f">{row.verdict}<") >= 1
        assert all(str(escape(command)) in text for command in figure.commands)
    assert all(target.startswith("#") or target == "data:," for _, target in page.loads)
    assert (result.agrees, result.differs, result.cannot_be_checked) == (12, 0, 1)
    assert set(result.not_made) == {figure.name for figure in paper.FIGURES} - set(SELECTED)
    assert "Not made yet: 2, 3B-D" in text


@pytest.mark.evidence
def test_all_figures_twice(tmp_path: Path) -> None:
    first, second = (tmp_path / name for name in ("one", "other"))
    result = reproduce(out=first).result
    reproduce(out=second)
    assert result.not_made == ()
    assert numbers(first) == numbers(second)
    for picture in (first / "figures").iterdir():
        assert picture.read_bytes() == (second / "figures" / picture.name).read_bytes(), picture.name
    by_key = {row.key: row for figure in result.figures for row in figure.comparisons}
    assert by_key["absorbance"].verdict == by_key["dispersion"].verdict == "differs"
    assert by_key["slab"].verdict == by_key["to-right"].verdict == by_key["in-space"].verdict == "agrees"
    assert by_key["control-measured"].verdict == "differs"
    assert {row.verdict for key, row in by_key.items() if key in {"pillar", "hole", "transmittance"}} == {
        "cannot be checked"
    }


@pytest.mark.evidence
def test_listed_commands_make_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reproduce(out=tmp_path)
    monkeypatch.chdir(tmp_path)
    for command in dict.fromkeys(command for figure in paper.FIGURES for command in figure.commands):
        words = shlex.split(command, comments=True)[1:]
        arguments = [
            name for word in words for name in (sorted(map(str, Path().glob(word))) if "*" in word else [word])
        ]
        assert run_command([*arguments, "--quiet"]) == 0, command


def test_docs_page_lists_all_figures_and_commands() -> None:
    text = (Path(__file__).resolve().parents[2] / "docs" / "paper-figures.md").read_text(encoding="utf-8")
    assert [command for figure in paper.FIGURES for command in figure.commands if command not in text] == []
    table = {
        letter
        for row in re.findall(r"^\| ([S\d][\w–]*) ", text, re.MULTILINE)
        for letter in letters_of(row.replace("–", "-"))
    }
    panels = {letter for figure in paper.FIGURES for letter in letters_of(figure.name)}
    assert table == panels - {"2", "S2", "S4", "S5"} | {
        "2A", "2B", "2C", "S2", "S4", "S5A", "S5B", "S5C", "S5D"
    }  # fmt: skip
