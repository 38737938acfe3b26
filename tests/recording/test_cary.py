"""Cary exports: each trace with its own wavelengths, also if Excel saved the file again, and damage rejected."""

from pathlib import Path

import numpy as np
import pytest

from solen.errors import DataError
from solen.recording import Recording, read
from tests.recording.exports import cary

THREE = [("film 1", "%T", 0), ("film 1", "%R", 3), ("dye", "Abs", 0)]


def saved(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "export.csv"
    path.write_bytes(text.encode(encoding))
    return path


def numbers(recording: Recording) -> dict[str, tuple[list[float], list[float]]]:
    """Return wavelengths and values of each trace, keyed by name."""
    return {
        channel.name: (recording.channel(channel.axis).values.tolist(), channel.values.tolist())
        for channel in recording.channels
        if channel.axis
    }


def test_traces_with_same_name_and_various_modes_and_lengths(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, cary(THREE)))
    traces = [channel for channel in recording.channels if channel.axis]
    assert [(channel.name, channel.quantity, channel.unit, channel.values.size) for channel in traces] == [
        ("film 1", "transmittance", "%", 40),
        ("film 1 (2)", "reflectance", "%", 37),
        ("dye", "absorbance", "1", 40),
    ]
    assert [recording.channel(channel.axis).values.size for channel in traces] == [40, 37, 40]
    assert recording.channel(traces[0].axis).unit == "nm"
    assert recording.channel(traces[0].axis).values[:2].tolist() == [900.0, 895.0]  # in the recorded, descending order
    assert traces[2].axis == traces[0].axis != traces[1].axis


def test_reads_log(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, cary(THREE)))
    provenance = recording.provenance
    assert (provenance.format, provenance.instrument, provenance.date) == (
        "agilent-cary-csv",
        "Cary 5000",
        "2021-03-17T13:45:42",
    )
    assert provenance.metadata["UV-Vis SBW (nm)"] == "2.000"
    assert "Y Mode" not in provenance.metadata
    assert [recording.channel(name).metadata["Y Mode"] for name in ("film 1", "film 1 (2)", "dye")] == [
        "%T",
        "%R",
        "Abs",
    ]
    assert "interrupted" in recording.channel("film 1 (2)").note


def resaved(text: str, separator: str = ",", mark: str = ".") -> str:
    """Return the export as Excel saves it again: rows of equal length, optionally with German separators."""
    rows = [line.split(",") for line in text.split("\r\n")[:-1]]
    width = max(map(len, rows))
    cells = [[cell.replace(".", mark) for cell in row + [""] * (width - len(row))] for row in rows]
    return "\r\n".join(separator.join(row) for row in cells) + "\r\n"


@pytest.mark.parametrize(
    "variant",
    [
        lambda text: text.replace("\r\n", "\n"),
        lambda text: text.replace("\r\n", "\r\r\n"),
        lambda text: "\ufeff" + resaved(text),
        lambda text: resaved(text, ";", ","),
        lambda text: resaved(text, "\t", ","),
        lambda text: text.replace(",\r\n", "\r\n"),
        lambda text: text.replace("Wavelength (nm)", '"Wavelength (nm)"').replace("dye,", '"dye",'),
    ],
    ids=["lf", "doubled", "excel", "german excel", "tabs", "no last comma", "quoted"],
)
def test_same_numbers_if_saved_by_other_programs(tmp_path: Path, variant: object) -> None:
    assert callable(variant)
    plain = numbers(read(saved(tmp_path, cary([("a", "%T", 0), ("dye", "Abs", 0), ("a", "%R", 0)]))))
    other = numbers(read(saved(tmp_path, variant(cary([("a", "%T", 0), ("dye", "Abs", 0), ("a", "%R", 0)])))))
    assert other == plain
    assert list(plain) == ["a", "dye", "a (2)"]


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "cp1252"])
def test_other_encodings(tmp_path: Path, encoding: str) -> None:
    text = cary([("Öl", "%T", 0), ("b", "%T", 0)])
    recording = read(saved(tmp_path, text, encoding))
    assert [channel.name for channel in recording.channels if channel.axis] == ["Öl", "b"]


def test_keeps_and_reports_negative_saturated_and_empty_values(tmp_path: Path) -> None:
    text = cary([("dark", "%T", 0), ("dense", "Abs", 0)], value=2.0)
    lines = text.split("\r\n")
    lines[4] = "890,-0.0012,890,10.000,"
    lines[5] = "885,,885,10,"
    recording = read(saved(tmp_path, "\r\n".join(lines)))
    dark, dense = recording.channel("dark"), recording.channel("dense")
    assert dark.values[2] == -0.0012
    assert np.isnan(dark.values[3])
    assert dense.values[2:4].tolist() == [10.0, 10.0]
    assert "negative" in dark.note
    assert "empty" in dark.note
    assert "2 values are at" in dense.note


def test_rows_without_separators_of_ended_traces(tmp_path: Path) -> None:
    text = cary([("a", "%T", 0), ("b", "%T", 4)], log=False)
    trimmed = "\r\n".join(line.rstrip(",") if line.endswith(",,,") else line for line in text.split("\r\n"))
    assert trimmed != text
    assert numbers(read(saved(tmp_path, trimmed))) == numbers(read(saved(tmp_path, text)))


DAMAGE = {
    "letter in a number": (lambda lines: lines.__setitem__(9, lines[9].replace("91.", "9l.")), "line 10, column 2"),
    "decimals after a comma": (lambda lines: lines.__setitem__(9, lines[9].replace("91.", "91,")), "line 10"),
    "a lost cell": (lambda lines: lines.__setitem__(9, lines[9].split(",", 1)[1]), "line 10"),
    "a surplus cell": (lambda lines: lines.__setitem__(9, "1," + lines[9]), "line 10"),
    "a repeated line": (lambda lines: lines.insert(9, lines[9]), "line 11, column 1"),
    "a lost line": (lambda lines: lines.pop(9), "line 10, column 1"),
    "lines swapped": (lambda lines: lines.insert(9, lines.pop(12)), "line 11, column 1"),
    "a wavelength off its step": (lambda lines: lines.__setitem__(9, lines[9].replace("865,", "863,", 1)), "line 10"),
    "a wavelength unlike the others": (
        lambda lines: lines.__setitem__(2, lines[2].replace("900,", "899,", 1)),
        "line 3",
    ),
    "a lost decimal point": (lambda lines: lines.__setitem__(9, lines[9].replace("91.", "91")), "line 10, column 2"),
    "an impossible value": (lambda lines: lines.__setitem__(9, "865,5e6" + lines[9][12:]), "line 10, column 2"),
    "a leading zero": (lambda lines: lines.__setitem__(9, lines[9].replace("91.", "01.")), "line 10, column 2"),
    "a line cut in the middle": (lambda lines: lines.__setitem__(9, lines[9][:11]), "line 10"),
    "a line cut in two": (lambda lines: lines.__setitem__(9, lines[9][:11] + "\r\n" + lines[9][11:]), "line 10"),
    "two lines joined": (lambda lines: lines.__setitem__(9, lines[9] + lines.pop(10)), "line 10"),
    "another separator": (lambda lines: lines.__setitem__(9, lines[9].replace(",", ";")), "line 10"),
    "an empty line inside": (lambda lines: lines.insert(9, ""), "line 11"),
    "a comment inside": (lambda lines: lines.__setitem__(9, "#" + lines[9]), "line 10"),
    "a lost name": (lambda lines: lines.__setitem__(0, lines[0].replace("b,", ",", 1)), "line 1, column 3"),
    "shifted names": (lambda lines: lines.__setitem__(0, lines[0].replace(",,", ",", 1)), "line 1"),
    "a damaged header": (lambda lines: lines.__setitem__(1, lines[1].replace("Wavelength", "Wavelenth", 1)), "line 2"),
    "a control character": (lambda lines: lines.__setitem__(9, lines[9].replace("9", "\x07", 1)), "line 10"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_rejects_damage_with_location(tmp_path: Path, damage: str) -> None:
    lines = cary([("a", "%T", 0), ("b", "%T", 0), ("c", "%T", 2)]).split("\r\n")
    change, location = DAMAGE[damage]
    change(lines)  # type: ignore[no-untyped-call]
    with pytest.raises(DataError, match=rf"{location}\b"):
        read(saved(tmp_path, "\r\n".join(lines)))


@pytest.mark.parametrize("cut", [1, 5, 12, 14])
def test_rejects_truncated_file(tmp_path: Path, cut: int) -> None:
    text = cary([("a", "%T", 0), ("b", "%T", 0)], log=False)
    with pytest.raises(DataError, match="line 42"):
        read(saved(tmp_path, text.removesuffix("\r\n")[:-cut]))


def test_accepts_scan_with_two_intervals(tmp_path: Path) -> None:
    waves = [*range(900, 800, -5), *range(800, 700, -1)]
    rows = [f"{wave},{90 + 1e-3 * wave:.8g}," for wave in waves]
    text = "\r\n".join(["film,", "Wavelength (nm),%T,", *rows, ""])
    recording = read(saved(tmp_path, text))
    assert recording.channel("film").values.size == len(waves)


def test_accepts_inexact_wavelength_drive(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    waves = 900.0 - np.arange(200) + rng.uniform(-0.02, 0.02, 200)
    rows = [f"{wave:.10g},{90 + 1e-3 * wave:.8g}," for wave in waves]
    recording = read(saved(tmp_path, "\r\n".join(["film,", "Wavelength (nm),%T,", *rows, ""])))
    assert recording.channel("film").values.size == 200


def test_log_is_kept_if_excel_saved_file_again(tmp_path: Path) -> None:
    for text in (resaved(cary(THREE)), resaved(cary(THREE), ";", ",")):
        recording = read(saved(tmp_path, text))
        assert recording.provenance.instrument == "Cary 5000"
        assert recording.provenance.metadata["<SBW (nm)>"].replace(",", ".") == "2.00"


def test_keeps_trace_without_points(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, cary([("a", "%T", 0), ("never scanned", "%T", 40)], log=False)))
    empty = recording.channel("never scanned")
    assert (empty.values.size, recording.channel(empty.axis).values.size) == (0, 0)
    assert "contains no points" in empty.note


def test_unknown_mode_has_no_unit(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, cary([("a", "F(R)", 0), ("b", "%T", 0)])))
    assert (recording.channel("a").quantity, recording.channel("a").unit) == ("", "")
    assert "F(R)" in recording.channel("a").note


def test_reads_complete_last_line_without_line_break(tmp_path: Path) -> None:
    text = "a,,b,\r\n" + "Wavelength (nm),%T,Wavelength (nm),%T\r\n"
    text += "\r\n".join(f"{900 - 5 * row},{90 + row / 8:.3f},{900 - 5 * row},{80 + row / 8:.3f}" for row in range(9))
    recording = read(saved(tmp_path, text))
    assert recording.channel("b").values[-1] == 81.0
    assert [note for note in recording.warnings if "after 81.000" in note and note.startswith("b")]
    assert not read(saved(tmp_path, text.replace("\r\n", ",\r\n").replace("%T,\r", "%T\r") + ",")).warnings
    for cut in range(1, 20):
        with pytest.raises(DataError, match="line 11"):
            read(saved(tmp_path, text[:-cut]))
