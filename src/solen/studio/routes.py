"""Routes of the tabs for forms, files and jobs; they return JSON, or one line if a request is rejected."""

import asyncio
import functools
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import TYPE_CHECKING, Any

from solen.errors import SolenError, SpecError
from solen.results import plain
from solen.studio.session import request_of
from solen.studio.workspace import CommandRequest, Workspace

if TYPE_CHECKING:
    from fastapi import FastAPI, Response

MAX_REQUEST_BYTES = 2**16
"""Maximum size of a request to a tab."""


def add(app: "FastAPI", workspace: Workspace) -> None:
    """Add the routes of a workspace to an application."""
    from fastapi import Request, Response
    from fastapi.responses import FileResponse

    async def forms(tab: str) -> Any:
        return await asyncio.to_thread(workspace.forms, tab)

    async def drop(request: Request, tab: str, name: str) -> Any:
        return await asyncio.to_thread(
            workspace.suitable_commands, tab, await workspace.storage.keep(name, request.stream())
        )

    async def begin(request: Request) -> Any:
        command = CommandRequest(**request_of(await _complete(request.stream())))
        return (await asyncio.to_thread(workspace.start, command)).head()

    async def cancel(number: int) -> Any:
        await asyncio.to_thread(workspace.document.jobs.by_number(number).cancel)

    async def result(number: int) -> Any:
        return workspace.document.jobs.by_number(number).result

    async def file(number: int, name: str) -> Any:
        path = workspace.file_of(number, name)
        return FileResponse(path, filename=None if path.suffix == ".svg" else path.name)

    async def image(name: str) -> Any:
        from solen.metrology.image import png_of

        data = await asyncio.to_thread(png_of, workspace.storage.path(name))
        return Response(data, media_type="image/png")

    async def member(number: int, name: str, name_in_archive: str) -> Any:
        kinds = {"png": "image/png", "json": "application/json"}
        kind = kinds.get(name_in_archive.rpartition(".")[2], "application/octet-stream")
        return Response(await asyncio.to_thread(workspace.member, number, name, name_in_archive), media_type=kind)

    for method, path, handler in (
        ("GET", "/tabs/{tab}", forms),
        ("PUT", "/files/{tab}/{name}", drop),
        ("GET", "/images/{name:path}", image),
        ("POST", "/jobs", begin),
        ("DELETE", "/jobs/{number}", cancel),
        ("GET", "/jobs/{number}", result),
        ("GET", "/jobs/{number}/{name}", file),
        ("GET", "/jobs/{number}/{name}/{name_in_archive}", member),
    ):
        app.add_api_route(f"/{{token}}{path}", _with_errors(handler), methods=[method], response_model=None)


def _with_errors(handler: Callable[..., Awaitable[Any]]) -> Callable[..., Awaitable["Response"]]:
    """Wrap the handler of a route, so that it returns JSON, or an error as one line."""
    from fastapi import Response

    @functools.wraps(handler)
    async def reply(**arguments: Any) -> "Response":
        try:
            content, status = await handler(**arguments), 200
        except SolenError as bad:
            content, status = {"what": str(bad)}, 400
        if isinstance(content, Response):
            return content
        return Response(json.dumps(plain(content), allow_nan=False), status, media_type="application/json")

    return reply


async def _complete(chunks: AsyncIterator[bytes]) -> bytes:
    """Return a complete message; raise `SpecError` if it is too long."""
    message = b""
    async for chunk in chunks:
        message += chunk
        if len(message) > MAX_REQUEST_BYTES:
            raise SpecError("message", limit=f"is longer than {MAX_REQUEST_BYTES} bytes")
    return message
