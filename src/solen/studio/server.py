"""The server of the studio: its files, and one WebSocket per page, for requests that the guard accepts."""

import asyncio
import contextlib
import secrets
import socket
from collections.abc import AsyncIterator, Callable
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from solen.errors import SolenError, SpecError
from solen.extras import need
from solen.studio import routes
from solen.studio.calls import PrintedLines
from solen.studio.document import Document
from solen.studio.guard import LOCAL, Guard
from solen.studio.session import Session
from solen.studio.workspace import Workspace

if TYPE_CHECKING:
    import uvicorn
    from fastapi import WebSocket

PAGE = files("solen.studio") / "page"
MEDIA_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
}
"""Media types of the files of the page, keyed by suffix; no other files are served."""
MAX_MESSAGE_BYTES = 2**16
"""Maximum size of a message from a page; a longer one closes its connection."""
MAX_PAGES, MAX_CONNECTIONS = 8, 64
UNSAVED_CHECK_S = 2.0
"""Interval between checks for unsaved changes."""
WS_TRY_AGAIN_LATER = 1013


def application(workspace: Workspace, token: str, address: str, port: int) -> Guard:
    """Return the ASGI application of a workspace at an address."""
    from fastapi import FastAPI, HTTPException, Response, WebSocket

    document = workspace.document
    names = {file.name for file in PAGE.iterdir()}

    @contextlib.asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        task = asyncio.create_task(_keep_unsaved(document))
        yield
        task.cancel()
        document.jobs.end()
        document.keep_unsaved()  # here, because the signal that stops the server may end the process

    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None, lifespan=lifespan)
    sessions: set[Session] = set()

    async def page(name: str) -> Response:
        name = name or "index.html"
        kind = MEDIA_TYPES.get(Path(name).suffix)
        if kind is None or name not in names:
            raise HTTPException(404)
        return Response((PAGE / name).read_bytes(), media_type=kind)

    async def exchange(socket: WebSocket) -> None:
        if len(sessions) >= MAX_PAGES:
            await socket.close(WS_TRY_AGAIN_LATER)
            return
        await socket.accept()
        await _serve(socket, document, sessions)

    app.add_api_websocket_route("/{token}/ws", exchange)
    routes.add(app, workspace)
    app.add_api_route("/{token}/{name:path}", page, response_class=Response, response_model=None)
    return Guard(app, token, address, port)


async def _serve(page: "WebSocket", document: Document, sessions: set[Session]) -> None:
    """Serve a page until it is closed; an error in its session closes the connection, which the page reports."""
    from fastapi import WebSocketDisconnect

    session = Session(document, page.send_bytes, sessions)
    sessions.add(session)
    tasks = [
        asyncio.create_task(session.work()),
        asyncio.create_task(_listen(page, session)),
        asyncio.create_task(session.watch()),
    ]
    try:
        for done in (await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED))[0]:
            with contextlib.suppress(WebSocketDisconnect):
                done.result()
    finally:
        sessions.discard(session)
        session.awake.set()  # ends the trace for this session
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            await page.close()


async def _keep_unsaved(document: Document) -> None:
    """Write unsaved changes next to the file soon after each change."""
    version_kept = -1
    while True:
        if document.version != version_kept:
            version_kept = document.version
            try:
                await asyncio.to_thread(document.keep_unsaved)
                document.unsaved_error = ""
            except SolenError as bad:
                document.unsaved_error = f"unsaved changes cannot be written next to the file: {bad}"
        await asyncio.sleep(UNSAVED_CHECK_S)


async def _listen(page: "WebSocket", session: Session) -> None:
    while (message := await page.receive())["type"] != "websocket.disconnect":
        await session.receive(message.get("text") or "")


def serve(
    document: Document,
    *,
    address: str = LOCAL,
    port: int = 0,
    announce: Callable[[str], object],
    printed_lines: PrintedLines | None = None,
) -> None:
    """Serve a document until Ctrl-C, and write unsaved changes next to its file.

    Parameters
    ----------
    document
        The design.
    address, port
        Address of this computer to listen on; port 0 selects a free one.
    announce
        Function called with the address of the page once connections are accepted.
    printed_lines
        Function of a module that returns the lines that a command prints, given its name and result.

    Raises
    ------
    OutputError
        If the packages of the extra ``studio`` are not installed.
    SpecError
        If the server cannot listen at this address.
    """
    server, listening, page = server_at(document, address, port, printed_lines)
    announce(page)
    with contextlib.suppress(KeyboardInterrupt), listening:
        server.run(sockets=[listening])


def server_at(
    document: Document, address: str = LOCAL, port: int = 0, printed_lines: PrintedLines | None = None
) -> "tuple[uvicorn.Server, socket.socket, str]":
    """Return the server of a document, its listening socket, and the address of the page; see `serve`."""
    need("fastapi", "uvicorn", "websockets", "tomlkit", what="solen studio")
    import uvicorn

    listening = _listening(address, port)
    port, token = listening.getsockname()[1], secrets.token_urlsafe(24)
    config = uvicorn.Config(
        application(Workspace(document, printed_lines), token, address, port),
        http="h11",
        ws="websockets-sansio",
        ws_max_size=MAX_MESSAGE_BYTES,
        ws_max_queue=8,
        ws_per_message_deflate=False,
        limit_concurrency=MAX_CONNECTIONS,
        h11_max_incomplete_event_size=2**14,
        lifespan="on",
        log_level="warning",
        access_log=False,
        server_header=False,
        date_header=False,
        timeout_graceful_shutdown=1,
    )
    return uvicorn.Server(config), listening, f"http://{address}:{port}/{token}/"


def _listening(address: str, port: int) -> socket.socket:
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listening.bind((address, port))
        listening.listen()
    except (OSError, OverflowError) as bad:
        listening.close()
        reason = getattr(bad, "strerror", None) or bad
        limit, remedy = f"cannot be used to listen: {reason}", "specify an IPv4 address of this computer"
        raise SpecError("--listen", value=f"{address}:{port}", limit=limit, remedy=remedy) from None
    return listening
