"""Addresses of the tabs: forms, files and jobs, each answered as JSON, or with one line if it is rejected."""

import asyncio
import functools
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import TYPE_CHECKING, Any

from solen.errors import SolenError, SpecError
from solen.results import plain
from solen.studio.session import request_of
from solen.studio.workspace import Order, Workspace

if TYPE_CHECKING:
    from fastapi import FastAPI, Response

MAX_REQUEST_BYTES = 2**16
"""Largest size in bytes of a request to a tab."""


def add(app: "FastAPI", workspace: Workspace) -> None:
    """Add the addresses of a desk to an application."""
    from fastapi import Request, Response
    from fastapi.responses import FileResponse

    async def forms(tab: str) -> Any:
        return await asyncio.to_thread(workspace.forms, tab)

    async def drop(request: Request, tab: str, name: str) -> Any:
        return await asyncio.to_thread(
            workspace.commands_for, tab, await workspace.storage.keep(name, request.stream())
        )

    async def begin(request: Request) -> Any:
        order = Order(**request_of(await _whole(request.stream())))
        return (await asyncio.to_thread(workspace.begin, order)).head()

    async def cancel(number: int) -> Any:
        await asyncio.to_thread(workspace.document.jobs.of(number).cancel)

    async def result(number: int) -> Any:
        return workspace.document.jobs.of(number).result

    async def file(number: int, name: str) -> Any:
        path = workspace.file_of(number, name)
        return FileResponse(path, filename=None if path.suffix == ".svg" else path.name)

    async def image(name: str) -> Any:
        from solen.metrology.image import png_of

        shown = await asyncio.to_thread(png_of, workspace.storage.path(name))
        return Response(shown, media_type="image/png")

    async def inside(number: int, name: str, part: str) -> Any:
        kinds = {"png": "image/png", "json": "application/json"}
        kind = kinds.get(part.rpartition(".")[2], "application/octet-stream")
        return Response(await asyncio.to_thread(workspace.inside, number, name, part), media_type=kind)

    for method, path, end in (
        ("GET", "/tabs/{tab}", forms),
        ("PUT", "/files/{tab}/{name}", drop),
        ("GET", "/images/{name:path}", image),
        ("POST", "/jobs", begin),
        ("DELETE", "/jobs/{number}", cancel),
        ("GET", "/jobs/{number}", result),
        ("GET", "/jobs/{number}/{name}", file),
        ("GET", "/jobs/{number}/{name}/{part}", inside),
    ):
        app.add_api_route(f"/{{token}}{path}", _refusing(end), methods=[method], response_model=None)


def _refusing(end: Callable[..., Awaitable[Any]]) -> Callable[..., Awaitable["Response"]]:
    """Wrap the handler of an address: its answer as JSON, and errors as one line."""
    from fastapi import Response

    @functools.wraps(end)
    async def answered(**given: Any) -> "Response":
        try:
            answer, status = await end(**given), 200
        except SolenError as bad:
            answer, status = {"what": str(bad)}, 400
        if isinstance(answer, Response):
            return answer
        return Response(json.dumps(plain(answer), allow_nan=False), status, media_type="application/json")

    return answered


async def _whole(parts: AsyncIterator[bytes]) -> bytes:
    """Return a complete message; raise `SpecError` if it is too long."""
    message = b""
    async for some in parts:
        message += some
        if len(message) > MAX_REQUEST_BYTES:
            raise SpecError("message", limit=f"is longer than {MAX_REQUEST_BYTES} bytes")
    return message
