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
    """Show a design in the browser: drag its parts, and see rays and response change. Ctrl-C stops the server.

    Parameters
    ----------
    file
        The design file; if it does not exist yet, an example that is saved there.
    listen
        IPv4 address to listen on. With any address other than 127.0.0.1, anyone who can reach it and knows the
        address of the page can read and change the design.
    no_browser
        Print the address of the page, but do not open it.
    beside
        Another design file, which is shown with its response for comparison.
    export
        Write a page with sliders to this .html file and exit; the page needs no server.
    """
    if export is not None:
        not_applicable = {"--listen": listen != LOCAL, "--no-browser": no_browser, "--beside": beside is not None}
        if given_options := [name for name, is_given in not_applicable.items() if is_given]:
            limit = "does not apply with --export, which starts no server"
            raise SpecError(", ".join(given_options), limit=limit, remedy="omit it")
        return write_page(file, export, options, set_, progress)
    if options != SlidersOptions():
        raise SpecError("--over, --drawn-rays", limit="apply only to an exported page", remedy="add --export page.html")
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

    def announce(address: str) -> None:
        print(json.dumps({"address": address}) if SHOWN.as_json else f"{file} at {address} (Ctrl-C ends)", flush=True)
        if not no_browser:
            webbrowser.open(address)

    serve(document, address=listen, announce=announce, printed_lines=printed)
    if document.unsaved_file is not None:
        print(f"unsaved changes are kept in {document.unsaved_file}", file=sys.stderr)


def printed(command: str, result: Any) -> list[str]:
    """Return the lines that a command such as ``resin cure`` prints for its result."""
    group, _, name = command.rpartition(" ")
    location = next(location for command_name, location, _ in COMMANDS[group] if command_name == name)
    importlib.import_module(f"solen.cli.{location.partition(':')[0]}")
    return list(lines(result))


@lines.register
def _(sliders: Sliders) -> Iterator[str]:
    dimension = "in space" if sliders.in_space else "in the plane"
    yield f"simulated: {sliders.name}, traced {dimension}; contrast uncertain by up to {sliders.u_largest:.1g}"
    for key, values in zip(sliders.keys, sliders.values, strict=True):
        yield f"  {key}: {', '.join(f'{value:g}' for value in values)}"
    if missing := sum(point is None for point in sliders.points):
        yield f"  {missing} of {len(sliders.points)} points cannot be built and are omitted"
