"""`solen studio`: the design in a browser, as it is changed."""

import json
import sys
import webbrowser
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen.cli.app import SHOWN
from solen.pipeline.design.designs import DESIGN_NAME
from solen.studio.document import Document
from solen.studio.guard import LOCAL
from solen.studio.server import serve


def studio(
    file: Path = Path(DESIGN_NAME),
    /,
    *,
    listen: str = LOCAL,
    no_browser: Annotated[bool, Parameter(name="--no-browser")] = False,
) -> None:
    """Show a design in the browser: drag its parts, and see rays and response change. Ctrl-C ends it.

    Parameters
    ----------
    file
        The design file; if there is none yet, an example that is saved there.
    listen
        IPv4 address to listen at. With any other than 127.0.0.1, everybody who reaches it and knows the page's address
        can read and change the design.
    no_browser
        Only print the page's address.
    """
    document = Document(file)
    if listen != LOCAL:
        line = f"warning: whoever reaches {listen} and knows the address below can read and change {file}, unencrypted"
        print(line, file=sys.stderr)

    def opened(address: str) -> None:
        print(json.dumps({"address": address}) if SHOWN.as_json else f"{file} at {address} (Ctrl-C ends)", flush=True)
        if not no_browser:
            webbrowser.open(address)

    serve(document, address=listen, opened=opened)
    if document.kept is not None:
        print(f"not saved, kept in {document.kept}", file=sys.stderr)
