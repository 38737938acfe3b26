"""Damaged exports: no crash, no endless loop, and no number that is silently wrong.

A file of computed numbers is damaged at random and read. Either it is rejected with a `DataError`, or every number is
at the same place as in the intact file, except for as many as the damage may have changed undetectably, from one digit
to another. The damage is known, so this number is counted for each file.
"""

import math
import random
from collections import Counter
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pytest

from solen.errors import DataError
from solen.recording import Recording, read
from tests.recording import programs
from tests.recording import test_arrays as arrays
from tests.recording.exports import cary, tensile
from tests.recording.mutate import KINDS, damaged
from tests.recording.old_excel import Cell, xls
from tests.recording.test_cary import resaved
from tests.recording.test_jcamp import jcamp
from tests.recording.test_lvm import lvm
from tests.recording.test_ocean import ocean
from tests.recording.test_programs import spc
from tests.recording.test_table import workbook
from tests.recording.test_testxpert import english

MIXED = [("film 1", "%T", 0), ("film 1", "%R", 4), ("dye", "Abs", 0)]
FILES: dict[str, bytes] = {
    "cary": cary(MIXED, points=24).encode(),
    "cary, one trace, no log": cary([("film", "%T", 0)], points=30, log=False).encode(),
    "cary, two traces": cary([("a", "%T", 0), ("b", "%R", 0)], points=16, step=0.5, log=False).encode(),
    "cary by a German Excel": resaved(cary(MIXED, points=20, log=False), ";", ",").encode("utf-8-sig"),
    "testxpert": tensile(30).encode("cp1252"),
    "testxpert, decimal comma": tensile(25).replace(".", ",").replace("\t", ";").encode("utf-8"),
    "testxpert, English": english(tensile(25)).encode("utf-16"),
    "lvm": lvm(20, 2).encode(),
    "OceanView": ocean().encode(),
    "SpectraSuite": ocean("SpectraSuite", ",").encode("cp1252"),
    "Jasco": programs.jasco().encode(),
    "Jasco, CSV": programs.jasco(",").encode(),
    "PerkinElmer .asc": programs.perkin_elmer().encode(),
    "Thorlabs": programs.thorlabs().encode(),
    "Avantes": programs.avantes(",").encode("cp1252"),
    "MTS 793": programs.mts(2).encode(),
    "Trapezium": programs.trapezium(1).encode(),
    "Bluehill": programs.bluehill().encode(),
    "MTS TestSuite": programs.mts_testsuite().encode("utf-8-sig"),
    "MTS TestSuite, text": programs.mts_testsuite("\t", "").encode(),
    "Lloyd NEXYGEN": programs.nexygen().encode(),
    "JCAMP-DX": jcamp("plain").encode(),
    "JCAMP-DX, pairs": jcamp("pairs").encode(),
    "JCAMP-DX, squeezed": jcamp("squeezed").encode(),
    "JCAMP-DX, differences": jcamp("differences").encode(),
    "lvm, decimal comma": lvm(30, x_columns="Multi", mark=",").encode("cp1252"),
}

ARRAYS = (arrays.write_matlab, arrays.write_matlab73, arrays.write_netcdf4, arrays.write_netcdf3, arrays.write_tdms)
BYTES = ("byte", "bit", "digit", "lost", "added", "part lost", "part doubled", "truncated")
"""Kinds of damage that do not depend on lines."""
TABLE: list[list[Cell]] = [["Time (s)", "Load (N)", "Machine Extension (mm)"]]
TABLE += map(list, zip(programs.TIME, programs.FORCE, programs.TRAVEL, strict=True))

Row = tuple[float, ...]
CARY = "agilent-cary-csv"


def rows(recording: Recording, *, traces: bool) -> list[list[Row]]:
    """Return rows of numbers: wavelengths and values of each trace, or all columns together."""
    tables = [recording.channels]
    if recording.provenance.format == CARY:
        tables = [(recording.channel(channel.axis), channel) for channel in recording.channels if channel.axis]
        tables = tables if traces else [tuple(channel for pair in tables for channel in pair)]
    if not traces:
        tables = [tuple(channel for channel in table if np.isfinite(channel.values).any()) for table in tables]
    return [list(zip_longest(*(channel.values.tolist() for channel in table), fillvalue=math.nan)) for table in tables]


def changed(whole: Sequence[Row], damaged_rows: Sequence[Row], *, ordered: bool) -> int:
    """Return the number of values that differ from those of the intact file.

    A row is compared with one that has at least half of its numbers; if there is none, all of its values differ. If
    ``ordered``, no row of the intact file is used twice.
    """
    count, position = 0, 0
    for row in damaged_rows:
        for later in range(position, len(whole)):
            same = sum(_same(a, b) for a, b in zip(row, whole[later], strict=False))
            if len(row) == len(whole[later]) and 2 * same >= len(row):
                count += len(row) - same
                position = later + 1 if ordered else 0
                break
        else:
            count += len(row)
    return count


def _same(first: float, second: float) -> bool:
    return first == second or (math.isnan(first) and math.isnan(second))


def outcome(folder: Path, name: str, seed: int) -> str:
    """Return whether a damaged file is rejected or how it is read; assert that no number is silently wrong.

    If the header is so damaged that the file is read as a plain table, its rows may repeat, and irregular numbers cause
    only a warning; so does a last number that may be truncated.
    """
    data, unseen, applied = damaged(seed, FILES[name])
    case = f"{name}, seed {seed}: {', '.join(applied)}"
    (folder / "file").write_bytes(data)
    try:
        recording = read(folder / "file")
    except DataError:
        return "refused"
    (folder / "whole").write_bytes(FILES[name])
    intact = read(folder / "whole")
    same_format = recording.provenance.format == intact.provenance.format
    if not same_format and max(trace.values.size for trace in recording.channels) < 2:
        return "read, only a list of results"
    pairs = list(zip_longest(rows(intact, traces=same_format), rows(recording, traces=same_format)))
    assert all(trace is not None and two is not None for trace, two in pairs), f"{case}: traces are lost"
    wrong = sum(changed(trace, damaged_trace, ordered=same_format) for trace, damaged_trace in pairs)
    truncated = any("ends without a line break" in trace for trace in recording.warnings)
    if wrong and recording.warnings and (not same_format or (truncated and wrong <= unseen + 1)):
        return "read, with a warning"
    assert wrong <= unseen, f"{case}: {wrong} numbers are not the file's"
    return "read, as it was" if wrong == 0 else "read, a digit changed"


def outcomes(folder: Path, name: str, seeds: range) -> Counter[str]:
    return Counter(outcome(folder, name, seed) for seed in seeds)


def binaries(folder: Path) -> dict[str, bytes]:
    """Return binary files, keyed by format."""
    files = {"SPC": spc(), "SPC, three spectra": spc(spectra=3, exponent=8), ".xls": xls({"test": TABLE})}
    for write in ARRAYS:
        write(folder / "binary")
        files[write.__name__.removeprefix("write_")] = (folder / "binary").read_bytes()
    return files | {".xlsx": workbook(folder, {"test": [list(row) for row in TABLE]}).read_bytes()}


def binary_outcome(folder: Path, name: str, whole: bytes, seed: int) -> str:
    """Return the same for a binary file.

    Most of these formats have no checksum of their numbers, so a changed byte changes a field. A file of another length
    is rejected, or has unchanged numbers.
    """
    rng = random.Random(seed)  # noqa: S311
    kind = rng.choice(BYTES)
    data, unseen = KINDS[kind](rng, whole)
    (folder / "whole").write_bytes(whole)
    (folder / "file").write_bytes(data)
    try:
        recording = read(folder / "file")
    except DataError as bad:
        assert "\n" not in str(bad)  # noqa: PT017
        return "refused"
    pairs = list(zip_longest(read(folder / "whole").channels, recording.channels))
    same = [first and second and np.array_equal(first.values, second.values, equal_nan=True) for first, second in pairs]
    if all(same):
        return "read, as it was"
    assert len(data) == len(whole), f"{name}, seed {seed}: of another length by {kind}, and read"
    assert unseen == 1
    return "read, a field changed"


def edited(name: str, *edits: tuple[str, str]) -> bytes:
    """Return one of the files with some strings replaced, each once."""
    text = FILES[name].decode("cp1252")
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    return text.encode("cp1252")


TWO_TRACES = FILES["cary, two traces"].decode().splitlines(keepends=True)
TENSION = FILES["testxpert"].decode("cp1252").splitlines(keepends=True)
CASES = {
    "the end of a line and the next one's beginning lost, within one column": (
        edited("testxpert", ("5\t0.813333\t785.607\n1.27\t0.423333\t0.749616", "74961")),
        "digits, but other numbers have at most 6",
    ),
    "a part of two lines doubled, so that a cell is empty": (
        "".join([*TENSION[:14], TENSION[13].replace("0.230331", ""), *TENSION[14:]]).encode("cp1252"),
        "line 15",
    ),
    "the names of traces repeated": ("".join([TWO_TRACES[0], *TWO_TRACES]).encode(), "more than their names"),
    "the names of traces lost": ("".join(TWO_TRACES[1:]).encode(), "lacks their names"),
    "the modes of traces lost": ("".join([TWO_TRACES[0], *TWO_TRACES[2:]]).encode(), "line 1"),
    "the header of one trace made part of the other's": (
        "".join(["a,ength (nm),%T,Wavelength (nm),%R,\r\n", *TWO_TRACES[2:]]).encode(),
        "is a wavelength outside 100 to 100000 nm",
    ),
    "a single cell of a table": ("".join([*TWO_TRACES[:2], "900"]).encode(), "line 3"),
    "a decimal point lost in one number": (edited("testxpert", ("785.573", "785573")), "line 35, column 5"),
    "digits lost in one number": (edited("testxpert", ("0.206667", "6667")), "line 25, column 2"),
    "the file ends among the parameters": ("".join(TENSION[:4]).encode("cp1252"), "line 1"),
    "the name of the time damaged, and lines swapped": (
        "".join(
            [*TENSION[:10], TENSION[10].replace("zeit", "zeFt"), *TENSION[11:20], TENSION[30], *TENSION[21:]]
        ).encode("cp1252"),
        "the time of a test must increase",
    ),
    "a decimal comma changed": (
        FILES["testxpert, decimal comma"].replace(b"0,34", b"0.34", 1),
        "a different decimal mark",
    ),
    "an incomplete UTF-8 character": (
        FILES["testxpert, decimal comma"].replace("ü".encode(), b"\xc3", 1),
        "not valid in UTF-8",
    ),
    "the file ends in its first row": ("".join([*TWO_TRACES[:2], "900,91,900"]).encode(), "line 3"),
    "a decimal comma in a factor": (
        edited("PerkinElmer .asc", ("\r\n1.0\r\n", "\r\n1,1\r\n")),
        "y factor",
    ),
    "an empty line before the last rows": (
        edited("cary, one trace, no log", ("\r\n765", "\r\n\r\n765")),
        "after the empty",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_rejects_known_damage(tmp_path: Path, case: str) -> None:
    data, part = CASES[case]
    (tmp_path / "file").write_bytes(data)
    with pytest.raises(DataError, match=part):
        read(tmp_path / "file")


def test_warns_of_single_row_without_line_break(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes("".join([*TWO_TRACES[:2], "900,91,900,91.3"]).encode())
    assert any("after 91.3: that number may be cut off" in warning for warning in read(tmp_path / "file").warnings)


def test_count_of_changed_numbers() -> None:
    whole = [(1.0, 2.0, math.nan), (3.0, 4.0, 5.0), (6.0, 7.0, 8.0)]
    assert changed(whole, whole, ordered=True) == 0
    assert changed(whole, whole[1:], ordered=True) == 0
    assert changed(whole, [whole[0], (3.0, 4.0, 5.5), whole[2]], ordered=True) == 1
    assert changed(whole, [whole[0], whole[0]], ordered=True) == 3
    assert changed(whole, [whole[0], whole[0]], ordered=False) == 0
    assert changed(whole, [(1.0, 7.0, 5.0)], ordered=True) == 3


@pytest.mark.parametrize("name", FILES)
def test_no_number_is_silently_wrong(tmp_path: Path, name: str) -> None:
    counts = outcomes(tmp_path, name, range(90))
    assert counts["refused"] > 20
    assert counts["read, as it was"] > 0


def test_rejects_binary_files_of_another_length(tmp_path: Path) -> None:
    for name, data in binaries(tmp_path).items():
        counts = Counter(binary_outcome(tmp_path, name, data, seed) for seed in range(25))
        assert counts["refused"] > 5, name


@pytest.mark.evidence
def test_no_number_is_silently_wrong_in_many_files(tmp_path: Path) -> None:
    """37,180 damaged files of 26 text formats, and 4,500 of nine binary ones."""
    for name in FILES:
        print(name, dict(outcomes(tmp_path, name, range(1000, 2430))))
    for name, whole in binaries(tmp_path).items():
        print(name, dict(Counter(binary_outcome(tmp_path, name, whole, seed) for seed in range(1000, 1500))))
