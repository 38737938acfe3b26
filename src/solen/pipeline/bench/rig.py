"""What the commands of the bench do: files to start from, a run from protocol to recording, runs that were left."""

import datetime as dt
import platform
import shutil
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.resources import files as resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen import __version__, files
from solen.bench.catalogue import NAME, Catalogue, header_of
from solen.bench.clock import Clock, Still, Wall
from solen.bench.close import Closed, check_installed, closed
from solen.bench.drivers import open_instruments
from solen.bench.frames import Layout
from solen.bench.journal import SUFFIX, Journal, Journaled, read_journal
from solen.bench.lock import Lock
from solen.bench.protocol import Protocol, load_protocol
from solen.bench.rig import Rig, load_rig
from solen.bench.roles import Daq, EmitterBoard, Stage
from solen.bench.run import Instruments, Watch, begin, cycles_done, parts_of
from solen.bench.run import run as run_protocol
from solen.errors import BenchError, DataError, OutputError, SolenError, SpecError
from solen.spec import loads, template, with_values
from solen.spec.toml import dumps

EXAMPLES = {
    "rotation": "rotation",
    "bending": "bending",
    "rig": "simulated",
    "rig-bending": "simulated-bending",
    "rig-daq": "simulated-daq",
}
"""Files to start from, and what is shipped as each."""
CHIP_MM = 0.2
"""Width of the chip in the shipped rigs' designs: a point emitter's response saturates within a degree."""
DESIGNS: dict[str, dict[str, Any]] = {
    "sensor": {"emitter.width_mm": CHIP_MM},
    "sensor-bending": {"emitter.width_mm": CHIP_MM, "motion.kind": "bend"},
}
"""Designs of the shipped rigs: what differs from the template."""
READ_S = 0.1
"""How often a board is read: what a kill may cost."""
READ_SIMULATED_S = 1.0
READ_SIMULATED_MOST_S = 10.0
"""A simulated board is read less often, in a long protocol least: its time passes faster than the wall's."""
ROOM_OF_JOURNAL, ROOM_BYTES = 1.5, 1 << 18
"""A recording takes no more room than its journal so many times, and so many bytes."""
LONGEST_NAME = 200
"""Of a recording, in bytes: with its ends it must be the name of a file everywhere."""
PAUSE_S = 1.0
"""At least so much later a run is taken up than it was left."""
Say = Callable[[str], None]


@dataclass(frozen=True)
class Asked:
    """A run as it is asked for.

    Attributes
    ----------
    protocol, rig
        Their files.
    out
        Folder of the recording.
    name
        Of the recording; by default that of the protocol's file.
    seed
        Instead of the rig file's.
    resume
        Take up a run that was left.
    real_time
        Let a simulated rig take the time that a real one takes.
    """

    protocol: Path
    rig: Path
    out: Path
    name: str | None = None
    seed: int | None = None
    resume: bool = False
    real_time: bool = False


def new(folder: Path) -> dict[str, Any]:
    """Write protocols, simulated rigs and their designs into a folder; existing files are never overwritten."""
    contents: dict[Path, files.Content] = {}
    for name, shipped in EXAMPLES.items():
        text = (resources("solen.bench") / "examples" / f"{shipped}.toml").read_text(encoding="utf-8")
        contents[folder / f"{name}.toml"] = text.encode()
    for name, values in DESIGNS.items():
        design = with_values(loads(template()), values)
        contents[folder / f"{name}.toml"] = dumps(design).encode()
    with files.output_folder(folder):
        for target in contents:
            if target.exists():
                raise OutputError(str(target), limit="exists already", remedy="name another folder or remove it")
        files.write_all(contents)
    return {"files": sorted(str(path) for path in contents)}


def run(asked: Asked, *, watch: Watch | None = None, say: Say | None = None) -> dict[str, Any]:
    """Run a protocol on a rig and close what was recorded.

    Raises
    ------
    BenchError, SpecError, DataError, DesignError, OutputError
        Where files, instruments or the folder are at fault. What was recorded by then is in the journal.
    """
    check_installed()
    protocol, rig = load_protocol(asked.protocol), load_rig(asked.rig)
    if asked.seed is not None:
        if not 0 <= asked.seed < 1 << 63:
            raise SpecError("--seed", value=asked.seed, limit="must be from 0 to 2^63 - 1")
        rig = rig.model_copy(update={"seed": asked.seed})
    _check_together(protocol, rig, asked)
    name = asked.name or asked.protocol.stem
    path, target = asked.out / f"{name}{SUFFIX}", asked.out / f"{name}.nc"
    _check_name(name)
    with files.output_folder(asked.out), Lock(path):
        if target.exists() and not (path.exists() and _is_of(target, path)):
            raise OutputError(str(target), limit="exists already", remedy="give the run another --name")
        if path.exists() and not asked.resume:
            limit, remedy = "exists already: a run that was not closed", "solen bench recover, or --resume"
            raise BenchError(str(path), limit=limit, remedy=remedy)
        journal, before = _journal_to_resume(path, asked, rig, protocol) if asked.resume else (None, None)
        with instruments(rig, protocol, asked, before, say) as (on, more):
            if journal is None:
                journal = begin(path, on, _header(protocol, rig, asked) | more)
            with journal:
                told = run_protocol(protocol, on, journal, before=before, watch=watch)
        return _close(path, target) | {"losses": told["losses"]}


def recover(path: Path) -> dict[str, Any]:
    """Close a journal that was left by a run that was killed, stopped or failed."""
    if path.suffix != SUFFIX:
        raise SpecError(str(path), limit=f"a journal ends in {SUFFIX}", remedy="name the journal of the run")
    target = path.with_suffix(".nc")
    with Lock(path):
        if target.exists() and not _is_of(target, path):
            raise OutputError(str(target), limit="exists already", remedy="move it away")
        return _close(path, target)


def recordings(folder: Path, *, look: bool = False) -> dict[str, Any]:
    """Recordings of a folder, and journals in it that were left."""
    if not folder.is_dir():
        raise SpecError(str(folder), limit="is no folder", remedy="name the folder of the recordings")
    catalogue = Catalogue(folder)
    strange = catalogue.look() if look or not (folder / NAME).exists() else ()
    return {
        "folder": str(folder),
        "recordings": [row.as_dict() for row in catalogue.rows()],
        "left": sorted(path.name for path in folder.glob(f"*{SUFFIX}")),
        "strange": list(strange),
    }


def _close(path: Path, target: Path) -> dict[str, Any]:
    """Close a journal, take the recording into the catalogue, and only then remove the journal.

    Whoever is killed on the way leaves the journal; a recording that was written by then is written anew.
    """
    files.remove_left(target)
    _check_room(path, target)
    journaled = read_journal(path)
    done = closed(journaled, target)
    row = Catalogue(target.parent).add(target)
    if row.periods != journaled.counts["samples" if "daq" in journaled.header else "board"]:
        raise OutputError(str(target), limit="does not hold what the journal holds", remedy=f"keep {path.name}")
    files.remove(path)
    return _told(done, journaled) | {"simulated": row.simulated}


def _check_room(path: Path, target: Path) -> None:
    """`OutputError` where the disk has no room for the recording of a journal."""
    needed = int(ROOM_OF_JOURNAL * path.stat().st_size) + ROOM_BYTES if path.exists() else 0
    free = shutil.disk_usage(target.absolute().parent).free if path.exists() else 0
    if free < needed:
        limit = f"needs up to {1e-6 * needed:.2g} MB, and {1e-6 * free:.2g} MB are free"
        raise OutputError(str(target), limit=limit, remedy=f"make room, then solen bench recover {path.name}")


def _is_of(target: Path, journal: Path) -> bool:
    """Whether a recording was made of a journal that is still there: who closed it was killed before removing it."""
    try:
        return header_of(target) == {
            key: value for key, value in read_journal(journal).header.items() if key != "streams"
        }
    except DataError:
        return False


def _told(done: Closed, journaled: Journaled) -> dict[str, Any]:
    return {
        "recording": str(done.path),
        "outcome": done.outcome,
        "cycles": cycles_done(journaled),
        "periods": done.periods,
        "duration_s": done.duration_s,
        "sensors": done.sensors,
        "lost_bytes": done.lost_bytes,
        "remarks": [*done.remarks, *(one["reason"] for one in journaled.events if one["what"] == "remark")],
    }


def _check_together(protocol: Protocol, rig: Rig, asked: Asked) -> None:
    unit = "mm" if rig.stage.lever_mm is not None else "deg"
    if protocol.unit != unit:
        remedy = "take the protocol or the rig of the other kind"
        raise BenchError(str(asked.protocol), limit=f"moves in {protocol.unit}, and the stage in {unit}", remedy=remedy)
    if asked.real_time and not rig.simulated:
        raise SpecError("--real-time", limit="is for a simulated rig; a real one takes its time anyway")
    if rig.simulated and {rig.stage.driver, rig.sampler.driver} != {"simulated"}:
        raise BenchError(str(asked.rig), limit="has one real and one simulated instrument", remedy="make both one kind")


def _check_name(name: str) -> None:
    if len(name.encode()) > LONGEST_NAME:
        limit = f"is {len(name.encode())} bytes long; {LONGEST_NAME} at most"
        raise SpecError("--name", value=f"{name[:20]}…", limit=limit, remedy="shorten it")
    if not name or any(sign in name for sign in '/\\:*?"<>|') or name.startswith("."):
        raise SpecError("--name", value=name, limit="must be the name of a file, without its folder")


def _journal_to_resume(path: Path, asked: Asked, rig: Rig, protocol: Protocol) -> tuple[Journal, Journaled]:
    if not path.exists():
        raise BenchError(str(path), limit="is not there: nothing was left", remedy="leave --resume out")
    header = read_journal(path).header
    for what, here in (("protocol", protocol.model_dump(mode="json")), ("rig", rig.model_dump(mode="json"))):
        if header[what] != here:
            remedy = "change it back, or close what is there with solen bench recover"
            raise BenchError(str(getattr(asked, what)), limit="is not what the run was begun with", remedy=remedy)
    return Journal.resume(path)


def _header(protocol: Protocol, rig: Rig, asked: Asked) -> dict[str, Any]:
    """What a run is known by for ever: everything it was made of."""
    designs = {one.design: files.read_text(asked.rig.parent / one.design, DataError) for one in rig.sensor}
    return {
        "solen": __version__,
        "python": platform.python_version(),
        "system": platform.platform(),
        "begun_utc": dt.datetime.now(dt.UTC).isoformat(timespec="seconds"),
        "simulated": rig.simulated,
        "clock": "as fast as it can be computed" if _still(rig, asked) else "wall",
        "seed": rig.seed,
        "protocol_name": protocol.name,
        "rig_name": rig.name,
        "protocol": protocol.model_dump(mode="json"),
        "rig": rig.model_dump(mode="json"),
        "designs": designs,
        "sensors": [one.model_dump(mode="json") for one in rig.sensor],
        "zero": rig.stage.zero,
        "lever_mm": rig.stage.lever_mm,
        "top_count": 2**rig.board.bits - 1,
    }


def _clock(still: bool, before: Journaled | None) -> Clock:
    """Time of a run; of one that is taken up it goes on, by as much as passed since."""
    if before is None:
        return Still() if still else Wall()
    ends = [
        rows["t_s"][-1:].max(initial=0.0) for name, rows in before.streams.items() if name not in {"board", "samples"}
    ]
    last = float(max(ends))
    if still:
        return Still(last + PAUSE_S)
    since = dt.datetime.now(dt.UTC) - dt.datetime.fromisoformat(before.header["begun_utc"])
    return Wall(max(since.total_seconds(), last + PAUSE_S))


def _read_every_s(rig: Rig, protocol: Protocol, asked: Asked) -> float:
    if not _still(rig, asked):
        return READ_S
    return min(max(READ_SIMULATED_S, protocol.shortest_s / 300.0), READ_SIMULATED_MOST_S)


def _still(rig: Rig, asked: Asked) -> bool:
    return rig.simulated and not asked.real_time


@contextmanager
def instruments(
    rig: Rig, protocol: Protocol, asked: Asked, before: Journaled | None, say: Say | None
) -> Iterator[tuple[Instruments, dict[str, Any]]]:
    """Instruments of a rig, closed in the end, and what is to be known of them."""
    clock = _clock(_still(rig, asked), before)
    more: dict[str, Any] = {}
    stage: Stage
    board: EmitterBoard | Daq
    if rig.simulated:
        stage, board, more = _simulated(rig, protocol, asked, clock, before, say)
    else:
        stage, board = open_instruments(rig, clock)
    try:
        yield Instruments(stage, board, clock, _read_every_s(rig, protocol, asked)), more
    finally:
        for one in (board, stage):  # how the run ended is what matters, and what could not be stopped is in its journal
            with suppress(SolenError):
                one.close()


def _simulated(
    rig: Rig,
    protocol: Protocol,
    asked: Asked,
    clock: Clock,
    before: Journaled | None,
    say: Say | None,
) -> tuple[Stage, EmitterBoard | Daq, dict[str, Any]]:
    from solen.bench.close import angle_deg
    from solen.bench.simulated.board import SimulatedBoard
    from solen.bench.simulated.daq import SimulatedDaq
    from solen.bench.simulated.prints import prints_of
    from solen.bench.simulated.stage import SimulatedStage

    wired = {"unit": protocol.unit, "zero": rig.stage.zero, "lever_mm": rig.stage.lever_mm}
    ends = np.array([-protocol.reach, protocol.reach]) + rig.stage.zero
    reach = float(np.abs(angle_deg(ends, wired)).max())
    # prints and noise are drawn apart, so that a run that is taken up has the same prints and other noise
    prints = prints_of(rig, asked.rig.parent, reach, np.random.default_rng([rig.seed, 0]), say)
    part = 0 if before is None else 1 + parts_of(before)
    named = [] if asked.name is None else [zlib.crc32(asked.name.encode())]
    noise = np.random.default_rng([rig.seed, 1, part, *named])
    stage = SimulatedStage(clock, protocol.unit)

    def angles(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return angle_deg(stage.axis.positions(time_s), wired)

    sampler: EmitterBoard | Daq
    if (setup := rig.setup) is not None:
        sampler = SimulatedDaq(clock, prints, angles, rig.ambient, setup, noise)
    else:
        layout, period_s = Layout(rig.emitters, rig.inputs), 1.0 / rig.board.rate_hz
        sampler = SimulatedBoard(clock, prints, angles, rig.ambient, layout, period_s, noise)
    drawn = [one.model_dump(mode="json") | {"drawn": made.drawn} for one, made in zip(rig.sensor, prints, strict=True)]
    return stage, sampler, {"sensors": drawn}
