"""Access control: only the page that the studio opened may send requests to it.

Any page of any site can send requests to a port of this computer. Therefore each address contains a random token; the
Host must be the one that was opened, which defeats names that resolve to this address; and an Origin, which browsers
add, must be the studio's own. The page itself may load only the studio's own files.
"""

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

READS, CHANGES = {"GET", "HEAD"}, {"PUT", "POST", "DELETE"}
"""HTTP methods; browsers send an Origin with those that change something, and all other clients must send it too."""
LOCAL = "127.0.0.1"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class Guard:
    """Pass on requests from the studio's own page, and reject all others."""

    def __init__(self, app: App, token: str, address: str, port: int) -> None:
        self.app, self.token, self.host = app, token, f"{address}:{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a request as an ASGI application."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        status = self._status(scope)
        if status == 200:
            await self.app(scope, receive, self._with_headers(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"cache-control", b"no-store")]
            await send({"type": "http.response.start", "status": status, "headers": headers})
            await send({"type": "http.response.body", "body": b"refused\n"})

    def _status(self, scope: Scope) -> int:
        """Return a request's HTTP status: 200 if the request is passed on."""
        headers = scope["headers"]
        hosts, origins = ([value for key, value in headers if key == name] for name in (b"host", b"origin"))
        own = f"http://{self.host}".encode()
        if hosts != [self.host.encode()] or any(origin != own for origin in origins):
            return 403
        method = scope.get("method", "")
        if scope["type"] == "http" and method not in READS | CHANGES:
            return 405
        if method not in READS and not origins:
            return 403
        token = scope["path"].split("/")[1]
        return 200 if secrets.compare_digest(token.encode(), self.token.encode()) else 404

    def _with_headers(self, send: Send) -> Send:
        policy = POLICY.format(host=self.host).encode()
        added = [
            (b"content-security-policy", policy),
            (b"x-content-type-options", b"nosniff"),
            (b"referrer-policy", b"no-referrer"),
            (b"cross-origin-opener-policy", b"same-origin"),
            (b"cross-origin-resource-policy", b"same-origin"),
            (b"cache-control", b"no-store"),
        ]

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *added]
            await send(message)

        return guarded
