"""Commands of the bench: example files, runs from protocol to recording, recovery of interrupted runs."""

from pathlib import Path

from solen import files
from solen.bench import catalogue
from solen.bench import record as bench
from solen.bench.homing import Confirm
from solen.bench.netcdf import RecordedRun
from solen.bench.run import Watch
from solen.bench.starter import starter_files
from solen.errors import OutputError
from solen.results import Outcome, Result


class BenchFolder(Result):
    """A folder with example files."""

    folder: Path


def new(folder: Path, /) -> Outcome[BenchFolder]:
    """Write protocols and simulated rigs with their designs into a folder.

    Parameters
    ----------
    folder
        Folder for rotation.toml, bending.toml, rig.toml (with a board), rig-daq.toml (with a data acquisition),
        sensor.toml, and the same for bending and for a press under a load cell.
    """
    texts = starter_files()
    targets = {name: folder / f"{name}.toml" for name in texts}
    with files.output_folder(folder):
        for target in targets.values():
            if target.exists():
                raise OutputError(str(target), limit="exists already", remedy="name another folder or remove it")
        files.write_all({targets[name]: text.encode() for name, text in texts.items()})
    return Outcome(BenchFolder(folder), targets)


def run(
    protocol: Path,
    rig: Path,
    out: Path,
    options: bench.RecordOptions = bench.RecordOptions(),
    *,
    watch: Watch | None = None,
    report: bench.Report | None = None,
    confirm: Confirm | None = None,
) -> Outcome[RecordedRun]:
    """Run a protocol on a rig and close the recording."""
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
        Also list recordings copied there by hand.
    """
    return Outcome(catalogue.list_recordings(folder, look=look))
