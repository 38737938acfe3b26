"""testXpert exports: channels by quantity, parameters as numbers, and damage rejected."""

from collections.abc import Callable
from pathlib import Path

import pytest

from solen.errors import DataError
from solen.recording import parameter, read
from tests.recording.exports import tensile

ENGLISH = {
    "aktuelle Probe": "Specimen no.",
    "Einspannlänge": "Grip to grip separation at the start position",
    "nicht bekannt": "unknown",
    "E-Modul": "Et",
    "Prüfzeit": "Test time",
    "Standardweg": "Standard travel",
    "Standardkraft": "Standard force",
    "Dehnung": "Strain",
    "Traverse abs.": "Crosshead absolute",
}


def english(text: str) -> str:
    for word, other in ENGLISH.items():
        text = text.replace(word, other)
    return text


def saved(folder: Path, text: str, encoding: str = "cp1252") -> Path:
    path = folder / "export.tra"
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8", "utf-8-sig", "utf-16"])
def test_channels_parameters_and_date(tmp_path: Path, encoding: str) -> None:
    recording = read(saved(tmp_path, tensile(), encoding))
    assert recording.provenance.format == "testxpert"
    assert recording.provenance.date == "2021-03-05"
    assert [(channel.quantity, channel.unit, channel.axis) for channel in recording.channels] == [
        ("time", "s", ""),
        ("displacement", "mm", "Prüfzeit"),
        ("force", "N", "Prüfzeit"),
        ("strain", "%", "Prüfzeit"),
        ("crosshead", "mm", "Prüfzeit"),
    ]
    assert recording.need("displacement").values[0] == 6e-5  # printed as 6e-005
    assert recording.need("force").values.size == 120
    assert parameter(recording, "E-Modul") == (3.41, "N/mm²")
    assert parameter(recording, "Bruchkraft") is None
    assert parameter(recording, "Kraft", "aktuelle  probe") == (4.0, "")


@pytest.mark.parametrize(
    "variant",
    [
        english,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\t", ";"),
        lambda text: text.replace('"', ""),
        lambda text: text.replace(".", ",").replace("abs,", "abs.").replace("05,03,2021", "05.03.2021"),
    ],
    ids=["english", "crlf", "semicolons", "bare", "decimal comma"],
)
def test_same_numbers_with_other_settings_of_program(tmp_path: Path, variant: Callable[[str], str]) -> None:
    plain = read(saved(tmp_path, tensile()))
    other = read(saved(tmp_path, variant(tensile())))
    assert other.provenance.format == "testxpert"
    for channel, other_channel in zip(plain.channels, other.channels, strict=True):
        assert (channel.quantity, channel.unit, channel.values.tolist()) == (
            other_channel.quantity,
            other_channel.unit,
            other_channel.values.tolist(),
        )
    assert parameter(other, "E-Modul", "Et") == (3.41, "N/mm²")


DAMAGE: dict[str, tuple[Callable[[list[str]], object], str]] = {
    "letter in a number": (lambda lines: lines.__setitem__(20, lines[20].replace(".", "x", 1)), "line 21, column 1"),
    "lost point": (lambda lines: lines.__setitem__(20, lines[20].replace("0.", "0", 1)), "line 21, column 1"),
    "decimals after a comma": (
        lambda lines: lines.__setitem__(20, lines[20].replace(".", ",", 1)),
        "line 21, column 1",
    ),
    "a lost cell": (lambda lines: lines.__setitem__(20, lines[20].split("\t", 1)[1]), "line 21"),
    "a surplus cell": (lambda lines: lines.__setitem__(20, lines[20] + "\t1"), "line 21, column 6"),
    "another separator": (lambda lines: lines.__setitem__(20, lines[20].replace("\t", ";", 1)), "line 21"),
    "a repeated line": (lambda lines: lines.insert(20, lines[20]), "line 22"),
    "lines swapped": (lambda lines: lines.insert(20, lines.pop(24)), "line 22, column 1"),
    "an empty line inside": (lambda lines: lines.insert(20, ""), "line 21"),
    "a comment inside": (lambda lines: lines.__setitem__(20, "#" + lines[20]), "line 21"),
    "a line cut in two": (lambda lines: lines.__setitem__(20, lines[20].replace("\t", "\n", 1)), "line 21"),
    "two lines joined": (lambda lines: lines.__setitem__(20, lines[20] + lines.pop(21)), "line 21"),
    "an unexpected exponent": (
        lambda lines: lines.__setitem__(20, lines[20].replace("785.", "785e", 1)),
        "line 21, column 5",
    ),
    "lost names of the channels": (lambda lines: lines.pop(10), "line 11"),
    "a damaged unit": (lambda lines: lines.__setitem__(11, lines[11].replace('"N"', '"x"')), "line 12"),
    "text after the numbers": (lambda lines: lines.insert(-1, "\nend"), "line 134"),
    "two specimens side by side": (
        lambda lines: lines.__setitem__(slice(10, None), [f"{line}\t{line}" for line in lines[10:]]),
        "2 specimens",
    ),
    "two specimens one below the other": (lambda lines: lines.extend(tensile().split("\n")), "2 specimens"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_rejects_damage_with_location(tmp_path: Path, damage: str) -> None:
    lines = tensile().split("\n")
    change, location = DAMAGE[damage]
    change(lines)
    with pytest.raises(DataError, match=rf"{location}\b"):
        read(saved(tmp_path, "\n".join(lines)))


def test_reports_last_number_that_may_be_truncated(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, tensile().removesuffix("\n")[:-1]))
    assert any("without a line break" in warning for warning in recording.warnings)


@pytest.mark.parametrize("cut", [3, 8, 25])
def test_rejects_truncated_file(tmp_path: Path, cut: int) -> None:
    with pytest.raises(DataError, match="line 132"):
        read(saved(tmp_path, tensile().removesuffix("\n")[:-cut]))
