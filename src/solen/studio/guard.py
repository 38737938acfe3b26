"""Access control: only the page that the studio opened may send requests to it.

A page from any site can send requests to a port of this computer. Therefore each address contains a random token; the
Host header must be the one that was opened, which prevents DNS rebinding; and an Origin header, which browsers add,
must be that of the studio. The page itself may load only files of the studio.
"""

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

READING_METHODS, CHANGING_METHODS = {"GET", "HEAD"}, {"PUT", "POST", "DELETE"}
"""HTTP methods; for those that change something, browsers send an Origin header, and all other clients must do so."""
LOCAL = "127.0.0.1"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class Guard:
    """ASGI application that forwards requests from the page of the studio, and rejects all others."""

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
        """Return the HTTP status of a request: 200 if it is forwarded."""
        headers = scope["headers"]
        hosts, origins = ([value for key, value in headers if key == name] for name in (b"host", b"origin"))
        origin_allowed = f"http://{self.host}".encode()
        if hosts != [self.host.encode()] or any(origin != origin_allowed for origin in origins):
            return 403
        method = scope.get("method", "")
        if scope["type"] == "http" and method not in READING_METHODS | CHANGING_METHODS:
            return 405
        if method not in READING_METHODS and not origins:
            return 403
        token = scope["path"].split("/")[1]
        return 200 if secrets.compare_digest(token.encode(), self.token.encode()) else 404

    def _with_headers(self, send: Send) -> Send:
        policy = POLICY.format(host=self.host).encode()
        security_headers = [
            (b"content-security-policy", policy),
            (b"x-content-type-options", b"nosniff"),
            (b"referrer-policy", b"no-referrer"),
            (b"cross-origin-opener-policy", b"same-origin"),
            (b"cross-origin-resource-policy", b"same-origin"),
            (b"cache-control", b"no-store"),
        ]

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *security_headers]
            await send(message)

        return guarded
