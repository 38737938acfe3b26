"""Cary exports: every trace with its own wavelengths, whatever Excel made of the file, and damage refused."""

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
    """Wavelengths and values of each trace by its name."""
    return {
        one.name: (recording.channel(one.axis).values.tolist(), one.values.tolist())
        for one in recording.channels
        if one.axis
    }


def test_traces_of_one_name_and_of_several_modes_and_lengths(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, cary(THREE)))
    traces = [one for one in recording.channels if one.axis]
    assert [(one.name, one.quantity, one.unit, one.values.size) for one in traces] == [
        ("film 1", "transmittance", "%", 40),
        ("film 1 (2)", "reflectance", "%", 37),
        ("dye", "absorbance", "1", 40),
    ]
    assert [recording.channel(one.axis).values.size for one in traces] == [40, 37, 40]
    assert recording.channel(traces[0].axis).unit == "nm"
    assert recording.channel(traces[0].axis).values[:2].tolist() == [900.0, 895.0]  # as recorded: downwards
    assert traces[2].axis == traces[0].axis != traces[1].axis


def test_what_the_log_says(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, cary(THREE)))
    told = recording.provenance
    assert (told.format, told.instrument, told.date) == ("agilent-cary-csv", "Cary 5000", "2021-03-17T13:45:42")
    assert told.metadata["UV-Vis SBW (nm)"] == "2.000"
    assert "Y Mode" not in told.metadata
    assert [recording.channel(name).metadata["Y Mode"] for name in ("film 1", "film 1 (2)", "dye")] == [
        "%T",
        "%R",
        "Abs",
    ]
    assert "interrupted" in recording.channel("film 1 (2)").note


def resaved(text: str, separator: str = ",", mark: str = ".") -> str:
    """What Excel writes after opening the export: all rows as long as the longest, perhaps in a German way."""
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
def test_other_programs_save_the_same_numbers(tmp_path: Path, variant: object) -> None:
    assert callable(variant)
    plain = numbers(read(saved(tmp_path, cary([("a", "%T", 0), ("dye", "Abs", 0), ("a", "%R", 0)]))))
    other = numbers(read(saved(tmp_path, variant(cary([("a", "%T", 0), ("dye", "Abs", 0), ("a", "%R", 0)])))))
    assert other == plain
    assert list(plain) == ["a", "dye", "a (2)"]


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "cp1252"])
def test_other_encodings(tmp_path: Path, encoding: str) -> None:
    text = cary([("Öl", "%T", 0), ("b", "%T", 0)])
    recording = read(saved(tmp_path, text, encoding))
    assert [one.name for one in recording.channels if one.axis] == ["Öl", "b"]


def test_negative_saturated_and_empty_values_are_kept_and_reported(tmp_path: Path) -> None:
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


def test_excel_leaves_out_separators_where_the_last_traces_have_ended(tmp_path: Path) -> None:
    text = cary([("a", "%T", 0), ("b", "%T", 4)], log=False)
    trimmed = "\r\n".join(line.rstrip(",") if line.endswith(",,,") else line for line in text.split("\r\n"))
    assert trimmed != text
    assert numbers(read(saved(tmp_path, trimmed))) == numbers(read(saved(tmp_path, text)))


DAMAGE = {
    "letter in a number": (lambda lines: lines.__setitem__(9, lines[9].replace("91.", "9l.")), "line 10, column 2"),
    "decimals after a comma": (lambda lines: lines.__setitem__(9, lines[9].replace("91.", "91,")), "line 10"),
    "a cell lost": (lambda lines: lines.__setitem__(9, lines[9].split(",", 1)[1]), "line 10"),
    "a cell too many": (lambda lines: lines.__setitem__(9, "1," + lines[9]), "line 10"),
    "a line twice": (lambda lines: lines.insert(9, lines[9]), "line 11, column 1"),
    "a line lost": (lambda lines: lines.pop(9), "line 10, column 1"),
    "lines changed about": (lambda lines: lines.insert(9, lines.pop(12)), "line 11, column 1"),
    "a wavelength off its step": (lambda lines: lines.__setitem__(9, lines[9].replace("865,", "863,", 1)), "line 10"),
    "a wavelength unlike the others": (
        lambda lines: lines.__setitem__(2, lines[2].replace("900,", "899,", 1)),
        "line 3",
    ),
    "a lost point": (lambda lines: lines.__setitem__(9, lines[9].replace("91.", "91")), "line 10, column 2"),
    "a value beyond any": (lambda lines: lines.__setitem__(9, "865,5e6" + lines[9][12:]), "line 10, column 2"),
    "a leading zero": (lambda lines: lines.__setitem__(9, lines[9].replace("91.", "01.")), "line 10, column 2"),
    "a line cut in the middle": (lambda lines: lines.__setitem__(9, lines[9][:11]), "line 10"),
    "a line cut in two": (lambda lines: lines.__setitem__(9, lines[9][:11] + "\r\n" + lines[9][11:]), "line 10"),
    "two lines made one": (lambda lines: lines.__setitem__(9, lines[9] + lines.pop(10)), "line 10"),
    "another separator": (lambda lines: lines.__setitem__(9, lines[9].replace(",", ";")), "line 10"),
    "an empty line inside": (lambda lines: lines.insert(9, ""), "line 11"),
    "a remark inside": (lambda lines: lines.__setitem__(9, "#" + lines[9]), "line 10"),
    "a name lost": (lambda lines: lines.__setitem__(0, lines[0].replace("b,", ",", 1)), "line 1, column 3"),
    "names shifted": (lambda lines: lines.__setitem__(0, lines[0].replace(",,", ",", 1)), "line 1"),
    "a header's word": (lambda lines: lines.__setitem__(1, lines[1].replace("Wavelength", "Wavelenth", 1)), "line 2"),
    "a control character": (lambda lines: lines.__setitem__(9, lines[9].replace("9", "\x07", 1)), "line 10"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_is_refused_with_its_place(tmp_path: Path, damage: str) -> None:
    lines = cary([("a", "%T", 0), ("b", "%T", 0), ("c", "%T", 2)]).split("\r\n")
    change, place = DAMAGE[damage]
    change(lines)  # type: ignore[no-untyped-call]
    with pytest.raises(DataError, match=rf"{place}\b"):
        read(saved(tmp_path, "\r\n".join(lines)))


@pytest.mark.parametrize("cut", [1, 5, 12, 14])
def test_a_file_that_was_cut_off_is_refused(tmp_path: Path, cut: int) -> None:
    text = cary([("a", "%T", 0), ("b", "%T", 0)], log=False)
    with pytest.raises(DataError, match="line 42"):
        read(saved(tmp_path, text.removesuffix("\r\n")[:-cut]))


def test_a_scan_in_two_intervals_is_no_damage(tmp_path: Path) -> None:
    waves = [*range(900, 800, -5), *range(800, 700, -1)]
    rows = [f"{wave},{90 + 1e-3 * wave:.8g}," for wave in waves]
    text = "\r\n".join(["film,", "Wavelength (nm),%T,", *rows, ""])
    recording = read(saved(tmp_path, text))
    assert recording.channel("film").values.size == len(waves)


def test_a_drive_that_is_not_exact_is_no_damage(tmp_path: Path) -> None:
    random = np.random.default_rng(7)
    waves = 900.0 - np.arange(200) + random.uniform(-0.02, 0.02, 200)
    rows = [f"{wave:.10g},{90 + 1e-3 * wave:.8g}," for wave in waves]
    recording = read(saved(tmp_path, "\r\n".join(["film,", "Wavelength (nm),%T,", *rows, ""])))
    assert recording.channel("film").values.size == 200


def test_what_excel_saved_again_keeps_its_log(tmp_path: Path) -> None:
    for text in (resaved(cary(THREE)), resaved(cary(THREE), ";", ",")):
        recording = read(saved(tmp_path, text))
        assert recording.provenance.instrument == "Cary 5000"
        assert recording.provenance.metadata["<SBW (nm)>"].replace(",", ".") == "2.00"


def test_a_trace_without_points_is_kept(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, cary([("a", "%T", 0), ("never scanned", "%T", 40)], log=False)))
    empty = recording.channel("never scanned")
    assert (empty.values.size, recording.channel(empty.axis).values.size) == (0, 0)
    assert "contains no points" in empty.note


def test_a_mode_that_is_not_known_keeps_its_numbers_without_a_unit(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, cary([("a", "F(R)", 0), ("b", "%T", 0)])))
    assert (recording.channel("a").quantity, recording.channel("a").unit) == ("", "")
    assert "F(R)" in recording.channel("a").note


def test_a_last_line_without_its_break_is_read_where_it_is_whole(tmp_path: Path) -> None:
    text = "a,,b,\r\n" + "Wavelength (nm),%T,Wavelength (nm),%T\r\n"
    text += "\r\n".join(f"{900 - 5 * row},{90 + row / 8:.3f},{900 - 5 * row},{80 + row / 8:.3f}" for row in range(9))
    recording = read(saved(tmp_path, text))
    assert recording.channel("b").values[-1] == 81.0
    assert [note for note in recording.warnings if "after 81.000" in note and note.startswith("b")]
    assert not read(saved(tmp_path, text.replace("\r\n", ",\r\n").replace("%T,\r", "%T\r") + ",")).warnings
    for cut in range(1, 20):
        with pytest.raises(DataError, match="line 11"):
            read(saved(tmp_path, text[:-cut]))
