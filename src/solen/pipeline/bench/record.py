"""Commands of the bench: example files, runs from protocol to recording, recovery of interrupted runs."""

import os
from pathlib import Path

from solen import files
from solen.bench import catalogue
from solen.bench import record as bench
from solen.bench.homing import Confirm
from solen.bench.netcdf import RecordedRun
from solen.bench.run import Watch
from solen.bench.starter import network_files, starter_files
from solen.results import Outcome, Result
from solen.spec import load


class BenchFolder(Result):
    """A folder with example files, and the name of the protocol to start with."""

    folder: Path
    protocol: str = "rotation.toml"


def new(folder: Path, /, *, design: Path | None = None) -> Outcome[BenchFolder]:
    """Write protocols and simulated rigs with their designs to a folder.

    Parameters
    ----------
    folder
        Folder for rotation.toml, rig.toml (with a board), rig-daq.toml (with a DAQ device), sensor.toml, and the
        files for bending and for a press with a load cell.
    design
        Design of a network: write instead a rig for it, and the protocols states.toml, for its calibration, and
        visits.toml, to check the calibration.
    """
    texts = starter_files() if design is None else network_files(load(design), _relative(design, folder))
    written = files.write_new(folder, {f"{name}.toml": text.encode() for name, text in texts.items()})
    protocol = "rotation.toml" if design is None else "states.toml"
    return Outcome(BenchFolder(folder, protocol), dict(zip(texts, written, strict=True)))


def _relative(design: Path, folder: Path) -> str:
    """Return the path of a design relative to a folder, with forward slashes; it is absolute if on another drive."""
    try:
        return Path(os.path.relpath(design.absolute(), folder.absolute())).as_posix()
    except ValueError:
        return design.absolute().as_posix()


def run(
    protocol: Path,
    /,
    rig: Path,
    out: Path,
    options: bench.RecordOptions = bench.RecordOptions(),
    *,
    watch: Watch | None = None,
    report: bench.Report | None = None,
    confirm: Confirm | None = None,
) -> Outcome[RecordedRun]:
    """Run a protocol on a rig and close the recording.

    Parameters
    ----------
    protocol
        Protocol file: the motion of the stage.
    rig
        Rig file: the instruments, and the sensors that are wired to them.
    """
    recorded = bench.record(protocol, rig, out, options, watch=watch, report=report, confirm=confirm)
    return Outcome(recorded, {"recording": recorded.path})


def recover(journal: Path, /) -> Outcome[RecordedRun]:
    """Convert the journal of a stopped or killed run to a recording.

    Parameters
    ----------
    journal
        The .journal file of the run.
    """
    recorded = bench.recover(journal)
    return Outcome(recorded, {"recording": recorded.path})


def recordings(folder: Path = Path(), /, *, look: bool = False) -> Outcome[catalogue.RecordingList]:
    """List the recordings of a folder.

    Parameters
    ----------
    folder
        The folder; default: the working directory.
    look
        Scan the folder for recordings that were copied there.
    """
    return Outcome(catalogue.list_recordings(folder, look=look))
