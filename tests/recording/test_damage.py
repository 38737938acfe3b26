"""Damaged exports: never a crash, never a hang, never a number that silently is not the file's.

A file of computed numbers is damaged at random and read. Either it is refused with a `DataError`, or every number that
comes back stands where it stood in the whole file; but for as many as the damage may have turned into other numbers
without a trace, a digit into a digit. What the damage did is known, so that is counted for each file.
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
"""Kinds of damage that know nothing of lines."""
TABLE: list[list[Cell]] = [["Time (s)", "Load (N)", "Machine Extension (mm)"]]
TABLE += map(list, zip(programs.TIME, programs.FORCE, programs.TRAVEL, strict=True))

Row = tuple[float, ...]
CARY = "agilent-cary-csv"


def rows(recording: Recording, *, traces: bool) -> list[list[Row]]:
    """Rows of numbers: of each trace its wavelengths and values, or of all columns together."""
    tables = [recording.channels]
    if recording.provenance.format == CARY:
        tables = [(recording.channel(one.axis), one) for one in recording.channels if one.axis]
        tables = tables if traces else [tuple(one for pair in tables for one in pair)]
    if not traces:
        tables = [tuple(one for one in table if np.isfinite(one.values).any()) for table in tables]
    return [list(zip_longest(*(one.values.tolist() for one in table), fillvalue=math.nan)) for table in tables]


def changed(whole: Sequence[Row], found: Sequence[Row], *, ordered: bool) -> int:
    """How many numbers of some rows are not those of the whole file; all those of a row that is like none of its rows.

    A row is compared with one that has at least half of its numbers. In order, no row of the file counts twice.
    """
    count, place = 0, 0
    for row in found:
        for later in range(place, len(whole)):
            same = sum(_same(a, b) for a, b in zip(row, whole[later], strict=False))
            if len(row) == len(whole[later]) and 2 * same >= len(row):
                count += len(row) - same
                place = later + 1 if ordered else 0
                break
        else:
            count += len(row)
    return count


def _same(one: float, other: float) -> bool:
    return one == other or (math.isnan(one) and math.isnan(other))


def outcome(folder: Path, name: str, seed: int) -> str:
    """What became of a damaged file: its refusal, or how it was read; fails where a number is silently wrong.

    A header may be damaged so that the file is a plain table to any reader; the rows of one may repeat, and what is odd
    about its numbers is a warning, no refusal. So it is where the last number of a file may have lost its end.
    """
    data, unseen, done = damaged(seed, FILES[name])
    about = f"{name}, seed {seed}: {', '.join(done)}"
    (folder / "file").write_bytes(data)
    try:
        found = read(folder / "file")
    except DataError:
        return "refused"
    (folder / "whole").write_bytes(FILES[name])
    whole = read(folder / "whole")
    kept = found.provenance.format == whole.provenance.format
    if not kept and max(one.values.size for one in found.channels) < 2:
        return "read, a list of results that is left"
    pairs = list(zip_longest(rows(whole, traces=kept), rows(found, traces=kept)))
    assert all(one is not None and two is not None for one, two in pairs), f"{about}: traces are lost"
    wrong = sum(changed(one, other, ordered=kept) for one, other in pairs)
    unended = any("ends without a line break" in one for one in found.warnings)
    if wrong and found.warnings and (not kept or (unended and wrong <= unseen + 1)):
        return "read, with a warning"
    assert wrong <= unseen, f"{about}: {wrong} numbers are not the file's"
    return "read, as it was" if wrong == 0 else "read, a digit changed"


def fuzzed(folder: Path, name: str, seeds: range) -> Counter[str]:
    return Counter(outcome(folder, name, seed) for seed in seeds)


def binaries(folder: Path) -> dict[str, bytes]:
    """Files that are no text, by what they are."""
    files = {"SPC": spc(), "SPC, three spectra": spc(spectra=3, exponent=8), ".xls": xls({"test": TABLE})}
    for write in ARRAYS:
        write(folder / "binary")
        files[write.__name__.removeprefix("write_")] = (folder / "binary").read_bytes()
    return files | {".xlsx": workbook(folder, {"test": [list(row) for row in TABLE]}).read_bytes()}


def binary_outcome(folder: Path, name: str, whole: bytes, seed: int) -> str:
    """The same of a file that is no text.

    Nothing in most of them checks their numbers: a byte that became another changes what one field holds. A
    file of another length is refused, or what it holds is what it held.
    """
    dice = random.Random(seed)  # noqa: S311
    kind = dice.choice(BYTES)
    data, unseen = KINDS[kind](dice, whole)
    (folder / "whole").write_bytes(whole)
    (folder / "file").write_bytes(data)
    try:
        found = read(folder / "file")
    except DataError as bad:
        assert "\n" not in str(bad)  # noqa: PT017
        return "refused"
    pairs = list(zip_longest(read(folder / "whole").channels, found.channels))
    same = [one and other and np.array_equal(one.values, other.values, equal_nan=True) for one, other in pairs]
    if all(same):
        return "read, as it was"
    assert len(data) == len(whole), f"{name}, seed {seed}: of another length by {kind}, and read"
    assert unseen == 1
    return "read, a field changed"


def edited(name: str, *edits: tuple[str, str]) -> bytes:
    """One of the files with some texts replaced, each once."""
    text = FILES[name].decode("cp1252")
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    return text.encode("cp1252")


TWO = FILES["cary, two traces"].decode().splitlines(keepends=True)
TEST = FILES["testxpert"].decode("cp1252").splitlines(keepends=True)
FOUND = {
    "the end of a line and the next one's beginning lost, within one column": (
        edited("testxpert", ("5\t0.813333\t785.607\n1.27\t0.423333\t0.749616", "74961")),
        "digits, but other numbers have at most 6",
    ),
    "a part of two lines doubled, so that a cell is empty": (
        "".join([*TEST[:14], TEST[13].replace("0.230331", ""), *TEST[14:]]).encode("cp1252"),
        "line 15",
    ),
    "the names of traces twice": ("".join([TWO[0], *TWO]).encode(), "more than their names"),
    "the names of traces lost": ("".join(TWO[1:]).encode(), "lacks their names"),
    "the modes of traces lost": ("".join([TWO[0], *TWO[2:]]).encode(), "line 1"),
    "the header of one trace made part of the other's": (
        "".join(["a,ength (nm),%T,Wavelength (nm),%R,\r\n", *TWO[2:]]).encode(),
        "no wavelength in nm",
    ),
    "one cell left of a table": ("".join([*TWO[:2], "900"]).encode(), "line 3"),
    "a decimal point lost in one number": (edited("testxpert", ("785.573", "785573")), "line 35, column 5"),
    "digits lost in one number": (edited("testxpert", ("0.206667", "6667")), "line 25, column 2"),
    "the file ends among the parameters": ("".join(TEST[:4]).encode("cp1252"), "line 1"),
    "the name of the time damaged, and lines changed about": (
        "".join([*TEST[:10], TEST[10].replace("zeit", "zeFt"), *TEST[11:20], TEST[30], *TEST[21:]]).encode("cp1252"),
        "the time of a test must increase",
    ),
    "a byte of a decimal comma": (
        FILES["testxpert, decimal comma"].replace(b"0,34", b"0.34", 1),
        "a different decimal mark",
    ),
    "a letter of UTF-8 broken": (
        FILES["testxpert, decimal comma"].replace("ü".encode(), b"\xc3", 1),
        "not valid in UTF-8",
    ),
    "the file ends in its first row": ("".join([*TWO[:2], "900,91,900"]).encode(), "line 3"),
    "a mark of decimals in a factor that is none": (
        edited("PerkinElmer .asc", ("\r\n1.0\r\n", "\r\n1,1\r\n")),
        "y factor",
    ),
    "an empty line before the last rows": (
        edited("cary, one trace, no log", ("\r\n765", "\r\n\r\n765")),
        "after the empty",
    ),
}


@pytest.mark.parametrize("case", FOUND)
def test_damage_that_was_once_read_without_a_word(tmp_path: Path, case: str) -> None:
    data, told = FOUND[case]
    (tmp_path / "file").write_bytes(data)
    with pytest.raises(DataError, match=told):
        read(tmp_path / "file")


def test_a_lone_row_without_its_end_is_warned_of(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes("".join([*TWO[:2], "900,91,900,91.3"]).encode())
    assert any("after 91.3: that number may be cut off" in one for one in read(tmp_path / "file").warnings)


def test_the_count_of_changed_numbers_counts() -> None:
    whole = [(1.0, 2.0, math.nan), (3.0, 4.0, 5.0), (6.0, 7.0, 8.0)]
    assert changed(whole, whole, ordered=True) == 0
    assert changed(whole, whole[1:], ordered=True) == 0
    assert changed(whole, [whole[0], (3.0, 4.0, 5.5), whole[2]], ordered=True) == 1
    assert changed(whole, [whole[0], whole[0]], ordered=True) == 3
    assert changed(whole, [whole[0], whole[0]], ordered=False) == 0
    assert changed(whole, [(1.0, 7.0, 5.0)], ordered=True) == 3


@pytest.mark.parametrize("name", FILES)
def test_no_number_is_silently_wrong(tmp_path: Path, name: str) -> None:
    found = fuzzed(tmp_path, name, range(90))
    assert found["refused"] > 20
    assert found["read, as it was"] > 0


def test_no_binary_file_of_another_length_is_read_as_if_it_were_whole(tmp_path: Path) -> None:
    for name, whole in binaries(tmp_path).items():
        found = Counter(binary_outcome(tmp_path, name, whole, seed) for seed in range(25))
        assert found["refused"] > 5, name


@pytest.mark.evidence
def test_no_number_is_silently_wrong_in_ten_thousand_files(tmp_path: Path) -> None:
    """37,180 damaged files of twenty-six kinds of text, and 4,500 of nine that are none."""
    for name in FILES:
        print(name, dict(fuzzed(tmp_path, name, range(1000, 2430))))
    for name, whole in binaries(tmp_path).items():
        print(name, dict(Counter(binary_outcome(tmp_path, name, whole, seed) for seed in range(1000, 1500))))
