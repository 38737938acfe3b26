"""Sample data for every command, copied into a folder."""

from pathlib import Path

from solen import files
from solen.results import Outcome
from solen.samples import Samples, sample_files


def examples(*, out: Path) -> Outcome[Samples]:
    """Copy sample data for every command, all simulated, into a folder.

    Parameters
    ----------
    out
        Folder for the copies, created if missing; its README.md describes each file. No existing file is replaced.
    """
    written = files.write_new(out, sample_files())
    return Outcome(Samples(out, len(written)), {"readme": out / "README.md"})
