"""Sample data for every command, copied into a folder."""

from pathlib import Path

from solen import files
from solen.errors import OutputError
from solen.results import Outcome
from solen.samples import Samples, sample_files


def examples(*, out: Path) -> Outcome[Samples]:
    """Copy sample data for every command, all simulated, into a folder.

    Parameters
    ----------
    out
        Folder to copy them to, created if missing; its README.md says what each file is for. Nothing is replaced.
    """
    contents = {out / name: content for name, content in sample_files().items()}
    with files.output_folder(out):
        for target in contents:
            if target.exists():
                raise OutputError(str(target), limit="exists already", remedy="name another folder or remove it")
        (out / "bench").mkdir(exist_ok=True)
        files.write_all(contents)
    return Outcome(Samples(out, len(contents)), {"readme": out / "README.md"})
