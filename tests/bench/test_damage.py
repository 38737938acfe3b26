"""Damaged journals and recordings: the records outside the damage are kept, and every error is one line."""

import shutil
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.bench import record as recording
from solen.bench.catalogue import entry_of
from solen.bench.journal import read_journal
from solen.bench.journal_content import JournalContent
from solen.bench.netcdf import write_recording
from solen.bench.record import RecordOptions, record, recover
from solen.bench.records import HEADER, Record
from solen.errors import DataError, SolenError
from solen.recording import read_parts
from solen.spec import template
from tests.bench.rig_support import PROTOCOL, RIG, daq_rig

Range = tuple[int, int]
Damage = Callable[[bytearray, np.random.Generator], tuple[bytes, list[Range]]]
"""Damages bytes, and returns the damaged bytes and the affected ranges of the original."""
FEW = 60
MANY = pytest.param(1000, marks=pytest.mark.evidence)


def flip_bits(data: bytearray, rng: np.random.Generator) -> tuple[bytes, list[Range]]:
    positions = rng.integers(0, len(data), rng.integers(1, 5)).tolist()
    for position in positions:
        data[position] ^= 1 << int(rng.integers(8))
    return bytes(data), [(position, position + 1) for position in positions]


def zero(data: bytearray, rng: np.random.Generator) -> tuple[bytes, list[Range]]:
    begin, size = int(rng.integers(0, len(data))), int(rng.choice([16, 512, 4096]))
    end = min(begin + size, len(data))
    data[begin:end] = bytes(end - begin)
    return bytes(data), [(begin, end)]


def truncate(data: bytearray, rng: np.random.Generator) -> tuple[bytes, list[Range]]:
    size = int(rng.integers(0, len(data)))
    return bytes(data[:size]), [(size, len(data))]


def remove_part(data: bytearray, rng: np.random.Generator) -> tuple[bytes, list[Range]]:
    begin = int(rng.integers(0, len(data)))
    end = min(begin + int(rng.choice([1, 512, 4096])), len(data))
    return bytes(data[:begin] + data[end:]), [(begin, end)]


def swap_blocks(data: bytearray, rng: np.random.Generator) -> tuple[bytes, list[Range]]:
    """Swap two blocks of 512 bytes; a record within a block stays intact, one across its border does not."""
    a, b = (512 * block for block in sorted(rng.choice(len(data) // 512, 2, replace=False).tolist()))
    data[a : a + 512], data[b : b + 512] = data[b : b + 512], data[a : a + 512]
    return bytes(data), [(a, a + 512), (b, b + 512)]


DAMAGES: list[Damage] = [flip_bits, zero, truncate, remove_part, swap_blocks]


@pytest.fixture(scope="module", params=["board", "daq"])
def ended_journal(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Journal of a run that has ended; its recording is in the same folder."""
    folder = tmp_path_factory.mktemp("damage")
    rig = RIG if request.param == "board" else daq_rig()
    for name, text in (("sensor", template("paper-860")), ("rig", rig), ("protocol", PROTOCOL)):
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording, "MIN_SIMULATED_READ_S", 0.1)
        patch.setattr("solen.files.remove", lambda _: None)
        record(folder / "protocol.toml", folder / "rig.toml", folder / "out", RecordOptions(name="kept"))
    return folder / "out" / "kept.journal"


def payloads(content: JournalContent) -> dict[int, bytes]:
    with content.path.open("rb") as file:
        return {record.number: record.payload(file) for record in content.records}


def check_one_line(error: SolenError) -> None:
    assert len(str(error).splitlines()) == 1


def intact_records(intact: JournalContent, damaged: list[Range], *, swapped: bool) -> list[Record]:
    """Return the records that a damage has left intact; blocks that were swapped keep the records within them."""

    def outside(record: Record) -> bool:
        return all(record.end <= begin or record.begin >= end for begin, end in damaged)

    def inside(record: Record) -> bool:
        return any(begin <= record.begin and record.end <= end for begin, end in damaged)

    return [record for record in intact.records if outside(record) or (swapped and inside(record))]


def check_journal(intact: JournalContent, path: Path, kept: list[Record]) -> str:
    """Check that a damaged journal has the records kept and no wrong one, and lists all others; return its state."""
    try:
        content = read_journal(path)
    except DataError as bad:
        check_one_line(bad)
        assert not [record for record in kept if record.kind == HEADER]
        return "no header"
    read, expected = payloads(content), payloads(intact)
    assert {record.number for record in kept} <= set(read)
    assert all(read[number] == expected[number] for number in read)
    missing = {number for gap in content.missing for number in range(gap.first, gap.last + 1)}
    assert missing == {number for number in range(max(read)) if number not in read}
    return "damaged" if content.damaged else "unfinished" if content.lost_bytes else "intact"


@pytest.mark.parametrize("damages", [FEW, MANY])
def test_damaged_journal_keeps_intact_records(ended_journal: Path, tmp_path: Path, damages: int) -> None:
    intact, rng = read_journal(ended_journal), np.random.default_rng(damages)
    data, path = ended_journal.read_bytes(), tmp_path / "damaged.journal"
    states: Counter[str] = Counter()
    longest_s = 0.0
    for number in range(damages):
        damage = DAMAGES[number % len(DAMAGES)]
        damaged, ranges = damage(bytearray(data), rng)
        path.write_bytes(damaged)
        begin_s = time.process_time()
        state = check_journal(intact, path, intact_records(intact, ranges, swapped=damage is swap_blocks))
        if state != "no header" and (damages > FEW or number % 12 == 0):
            content = read_journal(path)
            run = write_recording(content, path.with_suffix(".nc"))
            assert any("damaged" in line for line in run.warnings) == content.damaged
            assert entry_of(run.path).periods == run.periods
        longest_s = max(longest_s, time.process_time() - begin_s)
        states[f"{damage.__name__}: {state}"] += 1
    if damages > FEW:
        assert longest_s < 5.0
        print(f"\n  {damages} damaged journals, at most {longest_s:.1f} s of CPU: {dict(sorted(states.items()))}")


def test_damaged_journal_is_kept_after_closing(ended_journal: Path, tmp_path: Path) -> None:
    path = tmp_path / "damaged.journal"
    data = bytearray(ended_journal.read_bytes())
    data[len(data) // 2] ^= 16
    path.write_bytes(data)
    run = recover(path)
    assert path.read_bytes() == data
    assert (run.missing_records, run.damaged_bytes > 0) == (1, True)
    assert "is damaged and is kept" in " ".join(run.warnings)
    assert "1 record between" in " ".join(run.warnings)


def columns_of(path: Path) -> list[tuple[str, list[FloatArray]]]:
    return [(name, [channel.values for channel in part.channels]) for name, part in read_parts(path)]


@pytest.mark.parametrize("damages", [FEW, MANY])
def test_refuses_damaged_recording(ended_journal: Path, tmp_path: Path, damages: int) -> None:
    intact, path = ended_journal.with_suffix(".nc"), tmp_path / "damaged.nc"
    data, rng = intact.read_bytes(), np.random.default_rng(damages)
    expected = columns_of(intact)
    outcomes: Counter[str] = Counter()
    longest_s = 0.0
    for number in range(damages):
        damage = DAMAGES[number % len(DAMAGES)]
        damaged, _ = damage(bytearray(data), rng)
        path.write_bytes(damaged)
        begin_s = time.process_time()
        try:
            entry_of(path)
            read = columns_of(path)
        except SolenError as bad:
            check_one_line(bad)
            outcomes[f"{damage.__name__}: refused"] += 1
        else:  # only the checksum was damaged, or the swapped blocks were equal
            assert [name for name, _ in read] == [name for name, _ in expected]
            for (_, columns), (_, expected_columns) in zip(read, expected, strict=True):
                assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(columns, expected_columns, strict=True))
            outcomes[f"{damage.__name__}: read correctly"] += 1
        longest_s = max(longest_s, time.process_time() - begin_s)
    assert sum(count for name, count in outcomes.items() if "refused" in name) > 0.5 * damages
    if damages > FEW:
        assert longest_s < 5.0
        print(f"\n  {damages} damaged recordings, at most {longest_s:.1f} s of CPU: {dict(sorted(outcomes.items()))}")


def test_xarray_opens_recording_with_checksum(ended_journal: Path, tmp_path: Path) -> None:
    import xarray as xr

    copy = Path(shutil.copy(ended_journal.with_suffix(".nc"), tmp_path / "copy.nc"))
    with xr.open_dataset(copy, engine="h5netcdf", group="A") as data:
        assert len(data["right"]) > 100
