"""Plain tables: spellings of headers, separators and decimal marks, columns of words, and damage rejected."""

import io
from pathlib import Path

import numpy as np
import openpyxl
import pytest

from solen.errors import DataError
from solen.recording import read, spectra
from solen.recording.numbers import is_number
from tests.recording.exports import cary, tensile


def saved(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "table.txt"
    path.write_bytes(text.encode(encoding))
    return path


def workbook(folder: Path, sheets: dict[str, list[list[object]]]) -> Path:
    book = openpyxl.Workbook()
    book.remove(book.worksheets[0])
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    path = folder / "book"
    book.save(path)
    return path


@pytest.mark.parametrize(
    "header",
    [
        *("thickness_um", "Thickness (µm)", "Thickness [um]", "thickness / µm", "Thickness, µm", "thickness um"),
        *("Dicke [µm]", "Schichtdicke (µm)", "Cure depth (μm)", "Dicke in µm", '"Thickness (micron)"'),
    ],
)
def test_spellings_of_thickness(tmp_path: Path, header: str) -> None:
    recording = read(saved(tmp_path, f"time_s;{header}\n1;25\n2;50\n"))
    channel = recording.need("thickness")
    np.testing.assert_allclose(channel.to("mm"), [0.025, 0.05], rtol=1e-15)
    assert channel.quantity == "thickness"


@pytest.mark.parametrize("head", ["t_s,left_V,right_V\n", "t,left,right\ns,V,V\n"])
@pytest.mark.parametrize("between", ["", "\n", "\ufeff"])
def test_repeated_headers_of_appended_files(tmp_path: Path, head: str, between: str) -> None:
    rows = [f"{0.1 * n:.1f},{2 + n},{3 + n}\n" for n in range(9)]
    repeated_header = f"{between}{head}"
    recording = read(
        saved(tmp_path, "".join([head, *rows[:3], repeated_header, *rows[3:6], repeated_header, *rows[6:]]))
    )
    assert [channel.values.tolist() for channel in recording.channels[1:]] == [
        [2.0 + n for n in range(9)],
        [3.0 + n for n in range(9)],
    ]
    assert any("repeated 2 times among" in line for line in recording.warnings)
    recording = read(saved(tmp_path, "".join([head, *rows[:3], repeated_header, *rows[3:]])))
    assert any("repeated once among" in line for line in recording.warnings)


def test_rejects_another_header_among_rows(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="line 4"):
        read(saved(tmp_path, "t_s,left_V\n1,2\n2,3\nt_s,right_V\n3,4\n"))


def test_simplest_spectrum(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, "wavelength_nm,T,R\n400,0.91,0.08\n500,0.92,0.079\n"))
    assert [(channel.name, channel.quantity, channel.unit, channel.axis) for channel in recording.channels] == [
        ("wavelength", "wavelength", "nm", ""),
        ("T", "transmittance", "", "wavelength"),
        ("R", "reflectance", "", "wavelength"),
    ]
    assert recording.channel("R").values.tolist() == [0.08, 0.079]
    assert recording.provenance.format == "table"
    assert len(recording.provenance.sha256) == 64


@pytest.mark.parametrize(
    "text",
    [
        "t / s,F (N)\n0.5,1.25\n1,2.5\n",
        "t / s;F (N)\r\n0,5;1,25\r\n1;2,5\r\n",
        "t / s;F (N)\n0,5;1,25\n1,0;2,50\n",
        "t / s\tF (N)\r0.5\t1.25\r1\t2.5\r",
        '"t / s","F (N)"\n"0,5","1,25"\n"1","2,5"\n',
        "t_s  F_N\n 0.5   1.25\n 1.0   2.50",
        "t_s F_N\n0,5 1,25\n1 2,5\n",
        "# a comment\nt,F\ns,N\n0.5,1.25\n\n1,2.5\n",
        "# t_s,F_N\n0.5,1.25\n1,2.5\n",
        "Zeit;Kraft;;\ns;N;;\n0,5;1,25;;\n1;2,5;;\n",
        "Operator: A\nRate (mm/min);5\n\nt_s;F_N\n0.5;1.25\n1;2.5\n\nchecked by hand\n",
    ],
)
def test_separators_decimal_marks_and_unit_rows(tmp_path: Path, text: str) -> None:
    recording = read(saved(tmp_path, text))
    assert recording.need("time", "t").to("s").tolist() == [0.5, 1.0]
    assert recording.need("force").to("N").tolist() == [1.25, 2.5]
    assert recording.channel(recording.names[1]).axis == recording.names[0]


def test_keeps_columns_of_words(tmp_path: Path) -> None:
    text = "length_mm,power_mW,replicate,orientation\n10,1.0,1,flat\n20,0.8,1,upright\n20,,2,flat\n"
    recording = read(saved(tmp_path, text))
    assert recording.names == ("length", "power", "replicate")
    assert recording.label("orientation", "build orientation") == ("flat", "upright", "flat")
    assert recording.label("Replicate") == ("1", "1", "2")
    assert recording.label("sample") is None
    assert np.isnan(recording.channel("power").values[2])


def test_numbers_columns_with_same_name(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, "wavelength_nm,a,a,b,a (2)\n400,1,2,3,4\n500,1,2,3,4\n"))
    assert recording.names == ("wavelength", "a", "a (3)", "b", "a (2)")
    assert [recording.channel(name).values[0] for name in recording.names[1:]] == [1, 2, 3, 4]


def test_unit_is_that_of_baseline(tmp_path: Path) -> None:
    text = "wavelength,Baseline 100%T,VG1,VG1.1\n2500,7.42,53.4,53.5\n2490,7.8,53.3,53.2\n"
    recording = read(saved(tmp_path, text))
    assert recording.names == ("wavelength", "Baseline 100%T", "VG1", "VG1.1")
    assert {(channel.quantity, channel.unit) for channel in recording.channels[1:]} == {("transmittance", "%")}
    assert "Baseline" in recording.channel("VG1").note
    assert recording.channel("wavelength").unit == "nm"
    assert len(recording.warnings) == 3


def test_column_names_of_caller(tmp_path: Path) -> None:
    path = saved(tmp_path, "    0.0255    1.0200\r\n    0.1344    1.1250")
    with pytest.raises(DataError, match=r"line 1; .*no header"):
        read(path)
    recording = read(path, columns=("stress_MPa", "stretch"))
    assert recording.need("stress").to("MPa").tolist() == [0.0255, 0.1344]
    assert recording.need("stretch").values.tolist() == [1.02, 1.125]
    with pytest.raises(DataError, match="outside the 1 columns"):
        read(path, columns=("stress_MPa",))
    with pytest.raises(DataError, match="named twice"):
        read(saved(tmp_path, "t_s,F_N\n1,2\n"), columns=("t_s", "F_N"))


@pytest.mark.parametrize(
    ("header", "mark"),
    [("Wavenumber (cm-1),Transmittance (%)", "."), ("Wellenzahl [1/cm];T (%)", ","), ("cm-1,%Transmittance", ".")],
)
def test_wavelengths_from_wavenumbers(tmp_path: Path, header: str, mark: str) -> None:
    rows = ["10000,90.5", "8000,91.25", "5000,89.75"]
    text = "\n".join(rows) if mark == "." else "\n".join(rows).replace(",", ";").replace(".", ",")
    (channel,) = spectra(read(saved(tmp_path, f"{header}\n{text}\n")))
    assert channel.wavelength_nm == pytest.approx([1000.0, 1250.0, 2000.0])
    assert (channel.channel.quantity, channel.channel.unit) == ("transmittance", "%")
    assert channel.channel.values.tolist() == [90.5, 91.25, 89.75]


def test_header_may_be_unit_of_axis(tmp_path: Path) -> None:
    (channel,) = spectra(read(saved(tmp_path, "nm,%T\n400,90.1\n401,90.2\n402,90.3\n")))
    assert channel.wavelength_nm.tolist() == [400.0, 401.0, 402.0]
    assert channel.ratio() == pytest.approx([0.901, 0.902, 0.903])


def test_names_of_caller_replace_incomplete_header(tmp_path: Path) -> None:
    path = saved(tmp_path, "time_s,left_V\n0.0,1.0,2.0\n0.1,1.1,2.1\n")
    with pytest.raises(DataError, match=r"has 3 numbers, but the header in line 1 has 2 names"):
        read(path)
    recording = read(path, columns=("time_s", "left_V", "right_V"))
    assert [channel.values.tolist() for channel in recording.channels] == [[0.0, 0.1], [1.0, 1.1], [2.0, 2.1]]


def test_nul_bytes_after_last_row(tmp_path: Path) -> None:
    table = b"time_s,left_V\n0.0,1.0\n0.1,1.1\n0.2,1.2\n"
    (tmp_path / "log.csv").write_bytes(table + bytes(512))
    recording = read(tmp_path / "log.csv")
    assert recording.need("left_V").values.tolist() == [1.0, 1.1, 1.2]
    assert any("512 NUL bytes" in line for line in recording.warnings)
    for broken in (bytes(4) + table, table[:-3] + bytes(9), table[:20] + bytes(2) + table[20:]):
        (tmp_path / "log.csv").write_bytes(broken)
        with pytest.raises(DataError, match=r"U\+0000"):
            read(tmp_path / "log.csv")


def test_samples_named_by_numbers(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, "wavelength_nm,2,4,6\n400,0.91,0.9,0.88\n500,0.92,0.91,0.9\n"))
    assert recording.names == ("wavelength", "2", "4", "6")
    assert recording.channel("wavelength").values.tolist() == [400.0, 500.0]


GOOD = "wavelength_nm,T,R\n400,0.91,0.08\n410,0.915,0.079\n420,0.92,0.078\n"


@pytest.mark.parametrize(
    ("old", "new", "location"),
    [
        ("0.915", "0.9l5", "line 3, column 2"),
        ("0.915", "0,915", "line 3"),
        ("410,0.915", "410;0.915", "line 3"),
        ("410,", "", "line 3"),
        ("0.079", "0.079,5", "line 3, column 4"),
        ("0.079", "0.079 5", "line 3, column 3"),
        (",0.078\n", "", "line 4"),
        ("410", "4_10", "line 3, column 1"),
        ("410", "inf", "line 3, column 1"),
        ("410", "1e999", "line 3, column 1"),
        ("410", "٤١٠", "line 3, column 1"),
        ("410", "1.410,5", "line 3"),
        ("0.915", '"0.915', "line 3"),
        ("0.915", "\x000.915", "line 3"),
        ("420,0.92,0.078\n", "\nmore,a,b\n420,0.92,0.078\n", "line 5, column 1"),
        ("400,", "1,2\n400,", "line 2"),
        ("420,0.92,0.078\n", "Mean;0.92\n", "line 4"),
        ("420", "-", "line 4, column 1"),
        ("wavelength_nm,T,R\n", "", "line 1"),
        ("wavelength_nm,T,R\n", "film\n", "line 1"),
    ],
)
def test_rejects_damage_with_location(tmp_path: Path, old: str, new: str, location: str) -> None:
    with pytest.raises(DataError, match=rf"{location}\b"):
        read(saved(tmp_path, GOOD.replace(old, new, 1)))


def test_rejects_numbers_with_units_in_cells(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="line 2; is not a row of numbers"):
        read(saved(tmp_path, "sample,thickness_um\nA,25 um\nB,50 um\n"))


@pytest.mark.parametrize(
    ("data", "part"),
    [
        (b"", "is empty"),
        (b" \n\n", "is empty"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1", "damaged workbook"),
        (b"%PDF-1.7 ...", "is a PDF"),
        (b"PK\x03\x04rest", "damaged archive"),
        (b"a,b\n1,2\n\x81,3\n", "line 3; contains a byte"),
        ("Dicke (µm),µ\n1,2\n".encode() + b"\xe4,3\n", "line 3; contains a byte"),
        (b"only words\n", "line 1"),
        (b"a,b\n", "line 1"),
        (b"# nothing\n", "contains no table"),
    ],
)
def test_rejects_other_files_in_one_line(tmp_path: Path, data: bytes, part: str) -> None:
    path = tmp_path / "file.csv"
    path.write_bytes(data)
    with pytest.raises(DataError, match=part) as error:
        read(path)
    assert "\n" not in str(error.value)
    with pytest.raises(DataError, match="no such file"):
        read(tmp_path / "absent.csv")
    with pytest.raises(DataError, match="is a folder"):
        read(tmp_path)


ROWS: list[list[object]] = [["Exposure (mJ/cm²)", "thickness_um", "replicate"], [20, 51.25, 1], [40, 88.125, 2]]


def test_workbook_is_same_table(tmp_path: Path) -> None:
    recording = read(workbook(tmp_path, {"notes": [["by hand"]], "data": ROWS}))
    assert recording.need("thickness").to("um").tolist() == [51.25, 88.125]
    assert recording.need("exposure").to("mJ/cm**2").tolist() == [20.0, 40.0]
    assert recording.label("replicate") == ("1", "2")


def test_sheet_is_named_or_only_one(tmp_path: Path) -> None:
    path = workbook(tmp_path, {"first": ROWS, "second": [["t_s"], [1.5]]})
    with pytest.raises(DataError, match="2 sheets with numbers; choose one of first, second"):
        read(path)
    with pytest.raises(DataError, match="'third'; has no such sheet; its sheets are first, second"):
        read(path, sheet="third")
    assert read(path, sheet="second").need("time").values.tolist() == [1.5]
    with pytest.raises(DataError, match="is not a workbook"):
        read(saved(tmp_path, GOOD), sheet="first")


def test_error_names_cell_of_workbook(tmp_path: Path) -> None:
    rows = [*ROWS, [60, "1OO", 3]]
    with pytest.raises(DataError, match="sheet data, cell B4 = '1OO'; is not a number"):
        read(workbook(tmp_path, {"data": rows}))


def test_rejects_formula_without_stored_result(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cell B4; contains a formula"):
        read(workbook(tmp_path, {"data": [*ROWS, [60, "=2*B3", 3]]}))


def test_rejects_column_of_words_below_unit(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="line 2, column 2 = '25 um'; is not a number"):
        read(saved(tmp_path, "time_s,thickness_um\n1,25 um\n2,50 um\n"))


def test_reports_wavelengths_out_of_order(tmp_path: Path) -> None:
    rows = [f"{wave},0.9" for wave in (400, 410, 420, 403, 440, 450, 460)]
    recording = read(saved(tmp_path, "\n".join(["wavelength_nm,T", *rows, ""])))
    assert "403 after 420" in recording.channel("wavelength").note
    scattered = [f"{wave},0.9" for wave in (405, 365, 405, 365, 405, 365, 405)]
    assert read(saved(tmp_path, "\n".join(["wavelength_nm,Ec", *scattered, ""]))).warnings == []


def test_reports_number_that_may_be_truncated(tmp_path: Path) -> None:
    text = "time_s,force_N\n1,2.51\n2,2.62\n3,2.73\n4,2"
    assert "after 2: that number may be cut off" in read(saved(tmp_path, text)).channel("force").note
    assert read(saved(tmp_path, text + ".84")).warnings == []
    assert read(saved(tmp_path, text + "\n")).warnings == []


@pytest.mark.parametrize("wave", ["91.37", "123456"])
def test_rejects_impossible_wavelength(tmp_path: Path, wave: str) -> None:
    with pytest.raises(DataError, match=r"line 3, column 1 = .*; is a wavelength outside 100 to 100000 nm"):
        read(saved(tmp_path, f"wavelength_nm,T\n400,0.9\n{wave},0.9\n"))


def test_rejects_unnamed_column_with_values(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"line 1; .*for column 2"):
        read(saved(tmp_path, "film,,dye\n1,2,3\n"))
    assert read(saved(tmp_path, "film,,dye\n1,,3\n")).names == ("film", "dye")
    assert read(saved(tmp_path, ",T,R\n5,0.9,0.1\n6,0.9,0.1\n")).names == ("column 1", "T", "R")
    assert read(saved(tmp_path, ",T,R\n0,0.9,0.1\n1,0.9,0.1\n")).names == ("T", "R")  # row numbers of pandas


def test_rejects_percentage_format_of_excel(tmp_path: Path) -> None:
    path = workbook(tmp_path, {"data": [["wavelength_nm", "T (%)"], [400, 0.91], [500, 0.92]]})
    book = openpyxl.load_workbook(io.BytesIO(path.read_bytes()))
    for cell in ("B2", "B3"):
        book["data"][cell].number_format = "0.0%"
    book.save(path)
    with pytest.raises(DataError, match="sheet data, cell B2 = '91 %'; is not a number"):
        read(path)


@pytest.mark.parametrize(
    ("text", "kind"), [(cary([("a", "%T", 0), ("b", "Abs", 2)]), "agilent-cary-csv"), (tensile(), "testxpert")]
)
def test_export_of_instrument_in_workbook(tmp_path: Path, text: str, kind: str) -> None:
    separator = "," if kind.startswith("agilent") else "\t"
    lines = [line.replace('"', "").split(separator) for line in text.splitlines()]
    rows: list[list[object]] = [[float(cell) if is_number(cell) else cell or None for cell in line] for line in lines]
    sheet = read(workbook(tmp_path, {"data": rows}))
    plain = read(saved(tmp_path, text))
    assert sheet.provenance.format == plain.provenance.format == kind
    for channel, other in zip(sheet.channels, plain.channels, strict=True):
        assert (channel.name, channel.unit, channel.quantity, channel.values.tolist()) == (
            other.name,
            other.unit,
            other.quantity,
            other.values.tolist(),
        )


def test_rejects_possible_thousands_comma(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="line 3, column 2 = '1,250'; may be"):
        read(saved(tmp_path, "time_s\tforce_N\n1\t980\n2\t1,250\n"))
    with pytest.raises(DataError, match=r"line 3, column 2 = '1,250\.5'; has a thousands separator"):
        read(saved(tmp_path, "time_s\tforce_N\n1\t980.5\n2\t1,250.5\n"))
    assert read(saved(tmp_path, "time_s\tforce_N\n1\t0,980\n2\t1,250\n")).need("force").values.tolist() == [0.98, 1.25]
    assert read(saved(tmp_path, "time_s\tforce_N\n1\t1,125\n2\t1,250\n")).need("force").values.tolist() == [1.125, 1.25]


def test_reports_isolated_value(tmp_path: Path) -> None:
    rows = [f"{wave},{91 + 1e-3 * wave:.6g}" for wave in range(400, 600, 10)]
    for index, shown in ((0, "9.4 at wavelength 400"), (7, "9.47 at wavelength 470"), (19, "9.59 at wavelength 590")):
        damaged = [row.replace(",91", ",9") if n == index else row for n, row in enumerate(rows)]
        (note,) = read(saved(tmp_path, "\n".join(["wavelength_nm,T (%)", *damaged, ""]))).warnings
        assert shown in note
    assert read(saved(tmp_path, "\n".join(["wavelength_nm,T (%)", *rows, ""]))).warnings == []


def test_rejects_wavelengths_in_metres(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="line 2, column 1 = '400'; is a wavelength outside"):
        read(saved(tmp_path, "Wavelength (m),T\n400,0.9\n"))
    assert read(saved(tmp_path, "Wavelength (µm),T\n0.4,0.9\n")).need("wavelength").to("nm").tolist() == [400.0]


def test_label_columns_have_no_axis(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, "wavelength_nm,T,replicate\n400,0.9,1\n500,0.9,1\n"))
    assert [channel.axis for channel in recording.channels] == ["", "wavelength", ""]
    recording = read(saved(tmp_path, "wavelength_nm,T,sample\n400,0.9,0.8\n500,0.9,0.7\n"))
    assert [channel.axis for channel in recording.channels] == [
        "",
        "wavelength",
        "wavelength",
    ]  # here, sample is the name of a spectrum
    recording = read(saved(tmp_path, "time_s,thickness_um,Nr\n2,50,1\n4,90,2\n"))
    assert [channel.axis for channel in recording.channels] == ["", "time", ""]


def test_rejects_second_table(tmp_path: Path) -> None:
    text = "sample,Fmax (N)\n1,12.5\n\nTime,Extension,Load\n(s),(mm),(N)\n0.0,0.0,0.1\n0.1,0.2,0.4\n"
    with pytest.raises(DataError, match="line 4; begins another table"):
        read(saved(tmp_path, text))


def test_ignores_separator_line_of_excel(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, "sep=;\nt_s;F_N\n1;2,5\n"))
    assert recording.need("force").values.tolist() == [2.5]
    assert recording.provenance.metadata == {}
    text = "sep=,\n" + cary([("a", "%T", 0), ("b", "Abs", 0)])
    assert read(saved(tmp_path, text)).provenance.format == "agilent-cary-csv"


def test_modes_in_percent_are_column_names(tmp_path: Path) -> None:
    path = tmp_path / "layer.csv"
    path.write_text("Wavelength (nm),%T,%R\n500,92.1,7.8\n510,92.0,7.8\n520,92.0,7.9\n", encoding="utf-8")
    recording = read(path)
    assert recording.need("transmittance").to("1")[0] == pytest.approx(0.921, rel=1e-15)
    assert recording.need("reflectance").to("1")[2] == pytest.approx(0.079, rel=1e-15)


def test_unit_determines_whether_elongation_is_strain(tmp_path: Path) -> None:
    for unit, quantity in (("%", "strain"), ("mm", "displacement")):
        path = tmp_path / "tension.csv"
        path.write_text(f"Elongation ({unit}),Stress (MPa)\n0,0\n1,0.01\n2,0.02\n", encoding="utf-8")
        assert read(path).channels[0].quantity == quantity
