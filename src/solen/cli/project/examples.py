"""Output of the command that copies sample data."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.pipeline.project.examples import examples as examples
from solen.samples import Samples


@lines.register
def _(copied: Samples) -> Iterator[str]:
    yield f"copied {copied.count} files to {copied.folder}; all of them are simulated, nothing was measured"
