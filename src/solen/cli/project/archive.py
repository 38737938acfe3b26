"""The commands that pack a sensor into an archive and unpack it."""

from collections.abc import Iterator, Sequence

from solen.archive import Archive, Item, Opened
from solen.cli.app import lines
from solen.pipeline.project.archive import pack as pack
from solen.pipeline.project.archive import unpack as unpack

MAX_COLUMNS = 10
"""Number of columns of a recording that are listed; the description has all."""


@lines.register
def _(archive: Archive) -> Iterator[str]:
    yield from _about(archive, archive.items)


@lines.register
def _(archive: Opened) -> Iterator[str]:
    yield from _about(archive, archive.items)
    yield "all sizes and checksums are unchanged"


def _about(archive: Archive | Opened, items: Sequence[Item]) -> Iterator[str]:
    yield f"{archive.name}, by {', '.join(archive.authors)}, {archive.licence}"
    wide = max(len(item.path) for item in items)
    for item in items:
        columns = [f"{name} ({unit})" if unit else name for name, unit in item.quantities.items()]
        simulated = ", simulated" if item.simulated else ""
        more = f" and {len(columns) - MAX_COLUMNS} more" if len(columns) > MAX_COLUMNS else ""
        held = f": {', '.join(columns[:MAX_COLUMNS])}{more}" if columns else ""
        yield f"{item.path:{wide}}  {item.size_bytes:>11,} bytes  {item.kind}{simulated}{held}"
