"""The command that writes a new design file."""

from collections.abc import Iterator
from pathlib import Path

from solen.cli.app import lines
from solen.results import Outcome
from solen.spec import NewDesign


def new(folder: Path, /, *, example: str = "solen-860") -> Outcome[NewDesign]:
    """Write a commented design file, FOLDER/sensor.toml.

    Parameters
    ----------
    folder
        Where to write it; made if need be.
    example
        Shipped design: solen-860, solen-500, solen-450 or pmma-860, with an LED as it is sold, in space; paper-860,
        paper-500 or paper-450, the point in the plane of the paper.
    """
    from solen.pipeline.design import designs

    return designs.new(folder, example)


@lines.register
def _(written: NewDesign) -> Iterator[str]:
    yield f"wrote {written.design}"
    yield f'next: solen run "{written.design}" --out out'
