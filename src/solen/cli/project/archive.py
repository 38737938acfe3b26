"""Output of the commands that pack and unpack the archive of a sensor."""

from collections.abc import Iterator, Sequence

from solen.archive import Archive, Item, Opened
from solen.cli.app import lines
from solen.pipeline.project.archive import pack as pack
from solen.pipeline.project.archive import unpack as unpack

MAX_COLUMNS = 10
"""Maximum number of columns of a recording that are listed; the description contains all of them."""


@lines.register
def _(archive: Archive) -> Iterator[str]:
    yield from _about(archive, archive.items)


@lines.register
def _(archive: Opened) -> Iterator[str]:
    yield from _about(archive, archive.items)
    yield "all sizes and checksums are unchanged"


def _about(archive: Archive | Opened, items: Sequence[Item]) -> Iterator[str]:
    yield f"{archive.name}, by {', '.join(archive.authors)}, {archive.licence}"
    width = max(len(item.path) for item in items)
    for item in items:
        columns = [f"{name} ({unit})" if unit else name for name, unit in item.quantities.items()]
        simulated = ", simulated" if item.simulated else ""
        remainder = f" and {len(columns) - MAX_COLUMNS} more" if len(columns) > MAX_COLUMNS else ""
        contents = f": {', '.join(columns[:MAX_COLUMNS])}{remainder}" if columns else ""
        yield f"{item.path:{width}}  {item.size_bytes:>11,} bytes  {item.kind}{simulated}{contents}"
