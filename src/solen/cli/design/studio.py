"""`solen studio`: an editable design in a browser, or a stand-alone page to send by mail."""

import importlib
import json
import sys
import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import SHOWN, lines
from solen.cli.commands import COMMANDS
from solen.errors import SpecError
from solen.explore.sliders import Sliders, SlidersOptions
from solen.pipeline.design.designs import DESIGN_NAME
from solen.pipeline.design.studio import export as write_page
from solen.pipeline.options import FLAT, ProgressBar, Set
from solen.results import Outcome
from solen.spec import parse_assignment
from solen.studio.guard import LOCAL


def studio(
    file: Path = Path(DESIGN_NAME),
    /,
    *,
    listen: str = LOCAL,
    no_browser: Annotated[bool, Parameter(name="--no-browser")] = False,
    beside: Path | None = None,
    export: Path | None = None,
    options: Annotated[SlidersOptions, FLAT] = SlidersOptions(),
    set_: Set = None,
    progress: ProgressBar = None,
) -> Outcome[Sliders] | None:
    """Show a design in the browser: drag its parts, and see rays and response change. Ctrl-C ends it.

    Parameters
    ----------
    file
        The design file; if it does not exist yet, an example that is saved there.
    listen
        IPv4 address to listen at. At any other than 127.0.0.1, everybody who reaches it and knows the page's address
        can read and change the design.
    no_browser
        Only print the page's address.
    beside
        Another design file to compare with this one, with its response.
    export
        Write a page with sliders to this .html file, which needs no server, and end.
    """
    if export is not None:
        refused = {"--listen": listen != LOCAL, "--no-browser": no_browser, "--beside": beside is not None}
        if stated := [name for name, given in refused.items() if given]:
            limit = "does not apply with --export, which serves nothing"
            raise SpecError(", ".join(stated), limit=limit, remedy="omit it")
        return write_page(file, export, options, set_, progress)
    if options != SlidersOptions():
        raise SpecError(
            "--over, --drawn-rays", limit="apply only to a stand-alone page", remedy="add --export page.html"
        )
    _serve(file, dict(parse_assignment(text) for text in set_ or ()), listen, beside, no_browser=no_browser)
    return None


def _serve(file: Path, changes: dict[str, Any], listen: str, beside: Path | None, *, no_browser: bool) -> None:
    from solen.studio.document import Document
    from solen.studio.server import serve

    document = Document(file)
    if changes:
        document.change(changes)
    if beside is not None:
        document.compare_with(beside)
    if listen != LOCAL:
        line = (
            f"warning: anyone who can reach {listen} and knows the address below can read and change "
            f"{file}; the connection is not encrypted"
        )
        print(line, file=sys.stderr)

    def opened(address: str) -> None:
        print(json.dumps({"address": address}) if SHOWN.as_json else f"{file} at {address} (Ctrl-C ends)", flush=True)
        if not no_browser:
            webbrowser.open(address)

    serve(document, address=listen, opened=opened, shown=printed)
    if document.kept is not None:
        print(f"not saved, kept in {document.kept}", file=sys.stderr)


def printed(command: str, result: Any) -> list[str]:
    """Return the lines that a command, such as ``resin cure``, prints for its result."""
    group, _, own = command.rpartition(" ")
    where = {name: place for name, place, _ in COMMANDS[group]}[own]
    importlib.import_module(f"solen.cli.{where.partition(':')[0]}")
    return list(lines(result))


@lines.register
def _(found: Sliders) -> Iterator[str]:
    where = "in space" if found.in_space else "in the plane"
    yield f"simulated: {found.name}, traced {where}; contrast known to {found.u_largest:.1g}"
    for key, values in zip(found.keys, found.values, strict=True):
        yield f"  {key}: {', '.join(f'{value:g}' for value in values)}"
    if missing := sum(point is None for point in found.points):
        yield f"  {missing} of {len(found.points)} cannot be built and are omitted"
