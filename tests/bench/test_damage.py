"""Journals and recordings with damaged bytes: what lies outside the damage is kept, and a refusal is one line."""

import shutil
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from solen.bench import record as recording
from solen.bench.catalogue import entry_of
from solen.bench.journal import read_journal
from solen.bench.journal_content import JournalContent
from solen.bench.netcdf import write_recording
from solen.bench.record import RecordOptions, record, recover
from solen.errors import DataError, SolenError
from solen.recording import read_parts
from solen.spec import template
from tests.bench.rig_support import PROTOCOL, RIG
from tests.bench.test_daq import DAQS, daq_rig

Range = tuple[int, int]
Damage = Callable[[bytearray, np.random.Generator], tuple[bytes, list[Range]]]
"""Damages bytes: what is left of them, and the places that were hit."""
FEW = 60
MANY = pytest.param(1000, marks=pytest.mark.evidence)


def flipped(data: bytearray, rng: np.random.Generator) -> tuple[bytes, list[Range]]:
    places = rng.integers(0, len(data), rng.integers(1, 5)).tolist()
    for place in places:
        data[place] ^= 1 << int(rng.integers(8))
    return bytes(data), [(place, place + 1) for place in places]


def zeroed(data: bytearray, rng: np.random.Generator) -> tuple[bytes, list[Range]]:
    begin, size = int(rng.integers(0, len(data))), int(rng.choice([16, 512, 4096]))
    end = min(begin + size, len(data))
    data[begin:end] = bytes(end - begin)
    return bytes(data), [(begin, end)]


def cut(data: bytearray, rng: np.random.Generator) -> tuple[bytes, list[Range]]:
    place = int(rng.integers(0, len(data)))
    return bytes(data[:place]), [(place, len(data))]


def taken_out(data: bytearray, rng: np.random.Generator) -> tuple[bytes, list[Range]]:
    begin = int(rng.integers(0, len(data)))
    end = min(begin + int(rng.choice([1, 512, 4096])), len(data))
    return bytes(data[:begin] + data[end:]), [(begin, end)]


def swapped(data: bytearray, rng: np.random.Generator) -> tuple[bytes, list[Range]]:
    """Two blocks of 512 bytes change places; a record within a block is whole, and one across its border is not."""
    a, b = (512 * place for place in sorted(rng.choice(len(data) // 512, 2, replace=False).tolist()))
    data[a : a + 512], data[b : b + 512] = data[b : b + 512], data[a : a + 512]
    return bytes(data), [(a, a + 512), (b, b + 512)]


DAMAGES: list[Damage] = [flipped, zeroed, cut, taken_out, swapped]


@pytest.fixture(scope="module", params=["board", "daq"])
def left(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A journal that was ended, and the recording that was made of it."""
    folder = tmp_path_factory.mktemp("damage")
    rig = RIG if request.param == "board" else daq_rig(DAQS["counter"])
    for name, text in (("sensor", template("paper-860")), ("rig", rig), ("protocol", PROTOCOL)):
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(recording, "READ_SIMULATED_S", 0.1)
        patched.setattr("solen.files.remove", lambda _: None)
        record(folder / "protocol.toml", folder / "rig.toml", folder / "out", RecordOptions(name="kept"))
    return folder / "out" / "kept.journal"


def payloads(content: JournalContent) -> dict[int, bytes]:
    with content.path.open("rb") as file:
        return {one.number: one.payload(file) for one in content.records}


def one_line(refusal: SolenError) -> None:
    assert len(str(refusal).splitlines()) == 1


def check_journal(whole: JournalContent, path: Path, hit: list[Range], *, moved: bool) -> str:
    """What lies outside a damage is there and nothing else; what is not is counted."""
    outside = {
        one.number for one in whole.records if all(one.end <= begin or one.begin >= end for begin, end in hit)
    } | {one.number for one in whole.records for begin, end in hit if moved and begin <= one.begin and one.end <= end}
    try:
        found = read_journal(path)
    except DataError as bad:
        one_line(bad)
        lost = not [one for one in whole.records if one.number in outside and one.kind == 1]
        return "no header" if lost else "refused with a whole header"
    kept, true = payloads(found), payloads(whole)
    assert outside <= set(kept)
    assert all(kept[number] == true[number] for number in kept)
    lacking = {number for one in found.missing for number in range(one.first, one.last + 1)}
    assert lacking == {number for number in range(max(kept)) if number not in kept}
    return "damaged" if found.damaged else "unfinished" if found.lost_bytes else "whole"


@pytest.mark.parametrize("damages", [FEW, MANY])
def test_damaged_journals_keep_what_is_whole_and_can_be_closed(left: Path, tmp_path: Path, damages: int) -> None:
    whole, rng = read_journal(left), np.random.default_rng(damages)
    data, path = left.read_bytes(), tmp_path / "damaged.journal"
    told: Counter[str] = Counter()
    longest_s = 0.0
    for number in range(damages):
        damage = DAMAGES[number % len(DAMAGES)]
        changed, hit = damage(bytearray(data), rng)
        path.write_bytes(changed)
        begun_s = time.process_time()
        outcome = check_journal(whole, path, hit, moved=damage is swapped)
        assert outcome != "refused with a whole header"
        if outcome != "no header" and (damages > FEW or number % 6 == 0):
            found = read_journal(path)
            run = write_recording(found, path.with_suffix(".nc"))
            assert any("damaged" in line for line in run.warnings) == found.damaged
            assert entry_of(run.path).periods == run.periods
        longest_s = max(longest_s, time.process_time() - begun_s)
        told[f"{damage.__name__}: {outcome}"] += 1
    if damages > FEW:
        assert longest_s < 5.0
        print(f"\n  {damages} damaged journals, at most {longest_s:.1f} s of CPU: {dict(sorted(told.items()))}")


def test_a_damaged_journal_is_kept_when_it_is_closed(left: Path, tmp_path: Path) -> None:
    path = tmp_path / "damaged.journal"
    data = bytearray(left.read_bytes())
    data[len(data) // 2] ^= 16
    path.write_bytes(data)
    run = recover(path)
    assert path.read_bytes() == data
    assert (run.missing_records, run.damaged_bytes > 0) == (1, True)
    assert "damaged and kept" in " ".join(run.warnings)
    assert "1 record between" in " ".join(run.warnings)


@pytest.mark.parametrize("damages", [FEW, MANY])
def test_damaged_recordings_are_refused_in_one_line(left: Path, tmp_path: Path, damages: int) -> None:
    good, path = left.with_suffix(".nc"), tmp_path / "damaged.nc"
    data, rng = good.read_bytes(), np.random.default_rng(damages)
    true = [(name, [channel.values for channel in one.channels]) for name, one in read_parts(good)]
    told: Counter[str] = Counter()
    longest_s = 0.0
    for number in range(damages):
        damage = DAMAGES[number % len(DAMAGES)]
        changed, _ = damage(bytearray(data), rng)
        path.write_bytes(changed)
        begun_s = time.process_time()
        try:
            entry_of(path)
            parts = [(name, [channel.values for channel in one.channels]) for name, one in read_parts(path)]
        except SolenError as bad:
            one_line(bad)
            told[f"{damage.__name__}: refused"] += 1
        else:  # the seal alone was hit, or blocks that were alike
            assert [name for name, _ in parts] == [name for name, _ in true]
            for (_, mine), (_, others) in zip(parts, true, strict=True):
                assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(mine, others, strict=True))
            told[f"{damage.__name__}: read as it was"] += 1
        longest_s = max(longest_s, time.process_time() - begun_s)
    assert sum(count for name, count in told.items() if "refused" in name) > 0.5 * damages
    if damages > FEW:
        assert longest_s < 5.0
        print(f"\n  {damages} damaged recordings, at most {longest_s:.1f} s of CPU: {dict(sorted(told.items()))}")


def test_a_sealed_recording_opens_elsewhere(left: Path, tmp_path: Path) -> None:
    import xarray as xr

    copy = Path(shutil.copy(left.with_suffix(".nc"), tmp_path / "copy.nc"))
    with xr.open_dataset(copy, engine="h5netcdf", group="A") as data:
        assert len(data["right"]) > 100
