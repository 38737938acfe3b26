"""The command that writes a new design file."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.pipeline.design.designs import new as new
from solen.spec import NewDesign


@lines.register
def _(result: NewDesign) -> Iterator[str]:
    yield f"wrote {result.design}"
    yield f'next: solen run "{result.design}" --out out'
