"""LabVIEW measurement files: all numbers, joined packets, and headers checked against the rows."""

from pathlib import Path

import numpy as np
import pytest

from solen.errors import DataError
from solen.recording import read


def lvm(
    rows: int = 12,
    packets: int = 1,
    *,
    x_columns: str = "One",
    separator: str = "\t",
    mark: str = ".",
    units: tuple[str, ...] = ("Volts", "Millivolts"),
) -> str:
    """Return a file of computed numbers in the form of LabVIEW's Write to Measurement File."""
    name = {"\t": "Tab", ",": "Comma"}[separator]
    head = ["Writer_Version 2", "Reader_Version 2", f"Separator {name}"]
    head += [f"Decimal_Separator {mark}", f"Multi_Headings {'Yes' if packets > 1 else 'No'}", f"X_Columns {x_columns}"]
    head += ["Time_Pref Absolute", "Operator lab", "Date 2026/03/01", "Time 10:22:33.125"]
    lines = ["LabVIEW Measurement", *(line.replace(" ", separator, 1) for line in head)]
    lines += [f"***End_of_Header***{separator}", separator]
    for packet in range(packets):
        lines += _packet(rows, packet, x_columns, separator, mark, units)
    return "\r\n".join(lines) + "\r\n"


def _packet(rows: int, packet: int, x_columns: str, separator: str, mark: str, units: tuple[str, ...]) -> list[str]:
    count, step = len(units), 0.001
    start = packet * rows * step

    def text(value: float) -> str:
        return f"{value:.6f}".replace(".", mark)

    def line(*cells: object) -> str:
        return separator.join(map(str, (*cells, "")))

    lines = [line("Channels", count), line("Samples", *[rows] * count), line("Date", *["2026/03/01"] * count)]
    lines += [line("Y_Unit_Label", *units), line("X_Dimension", *["Time"] * count), line("X0", *[text(start)] * count)]
    lines += [line("Delta_X", *[text(step)] * count), line("***End_of_Header***")]
    names = [f"Voltage_{n}" for n in range(count)]
    multi = [cell for name in names for cell in ("X_Value", name)]
    lines.append(separator.join([*(multi if x_columns == "Multi" else ["X_Value", *names]), "Comment"]))
    for row in range(rows):
        x = text(start + row * step)
        values = [text(value) for value in values_at(packet * rows + row, count)]
        pairs = [cell for value in values for cell in (x, value)]
        lines.append(line(*(pairs if x_columns == "Multi" else ["" if x_columns == "No" else x, *values])))
    return [*lines, ""]


def values_at(row: int, count: int) -> list[float]:
    return [round(1.5 + 0.01 * row + n, 6) for n in range(count)]


def saved(folder: Path, text: str) -> Path:
    (folder / "file.lvm").write_text(text, encoding="utf-8", newline="")
    return folder / "file.lvm"


@pytest.mark.parametrize("x_columns", ["No", "One", "Multi"])
@pytest.mark.parametrize(("separator", "mark"), [("\t", "."), ("\t", ","), (",", ".")])
@pytest.mark.parametrize("packets", [1, 3])
def test_reads_all_numbers(tmp_path: Path, x_columns: str, separator: str, mark: str, packets: int) -> None:
    recording = read(saved(tmp_path, lvm(8, packets, x_columns=x_columns, separator=separator, mark=mark)))
    assert recording.provenance.format == "lvm"
    assert [(channel.name, channel.unit) for channel in recording.channels] == [
        ("time", "s"),
        ("Voltage_0", "V"),
        ("Voltage_1", "mV"),
    ]
    assert recording.channels[0].values == pytest.approx(0.001 * np.arange(8 * packets), abs=1e-9)
    expected = np.array([values_at(row, 2) for row in range(8 * packets)])
    assert np.column_stack([channel.values for channel in recording.channels[1:]]) == pytest.approx(expected, abs=1e-12)
    assert recording.provenance.date == "2026-03-01"


@pytest.mark.parametrize(
    ("before", "after", "part"),
    [
        ("Samples\t12\t12", "Samples\t13\t13", "12 rows, but the header specifies 13"),
        ("0.004000\t", "0.014000\t", "line 27; has a time that differs"),
        ("1.540000", "1.54x", "line 27, column 2 = '1.54x'"),
        ("Channels\t2", "Channels\t3", "names 2 channels, but the header specifies 3"),
        ("Voltage_1\tComment", "", "names 1 channel, but the header specifies 2"),
        ("X0\t0.000000\t0.000000", "X0\t0.000000\t0.500000", "have different times"),
    ],
)
def test_checks_packet_header_against_rows(tmp_path: Path, before: str, after: str, part: str) -> None:
    text = lvm()
    assert before in text
    with pytest.raises(DataError, match=part):
        read(saved(tmp_path, text.replace(before, after, 1)))


def test_rejects_truncated_file(tmp_path: Path) -> None:
    text = lvm(40)
    for fraction in (0.05, 0.2, 0.5, 0.9):
        with pytest.raises(DataError):
            read(saved(tmp_path, text[: int(fraction * len(text))]))


def appended(text: str, times: tuple[str, ...]) -> str:
    """Return a file that was appended to; each part has its own header, X from 0 and a clock time."""
    stamped = "Date\t2026/03/01\t2026/03/01\t\r\nTime\t{0}\t{0}\t\r\nY_Unit"
    return "".join(
        text.replace("Date\t2026/03/01\t2026/03/01\t\r\nY_Unit", stamped.format(clock_time)) for clock_time in times
    )


def test_times_of_appended_file_follow_time_stamps(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, appended(lvm(8), ("23:59:59.5", "23:59:59.75", "23:59:59.875"))))
    expected = np.concatenate([0.001 * np.arange(8) + start for start in (0.0, 0.25, 0.375)])
    assert recording.channels[0].values == pytest.approx(expected, abs=1e-9)
    assert recording.channels[1].values == pytest.approx([values_at(row % 8, 2)[0] for row in range(24)])


@pytest.mark.parametrize("times", [("10:00:00", "10:00:00.002"), ("10:00:00", "09:00:00"), ("10:00:00", "then")])
def test_rejects_packets_that_overlap_in_time(tmp_path: Path, times: tuple[str, ...]) -> None:
    with pytest.raises(DataError, match="whose times overlap"):
        read(saved(tmp_path, appended(lvm(8), times)))


def test_rejects_packets_with_other_channels(tmp_path: Path) -> None:
    two = lvm(5).rpartition("***End_of_Header***")[0]
    other = lvm(5, units=("Volts",))
    packet = other[other.index("Channels") :]
    assert two
    with pytest.raises(DataError, match="packet 2"):
        read(saved(tmp_path, lvm(5) + packet))
