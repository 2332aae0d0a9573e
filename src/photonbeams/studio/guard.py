"""Who may ask the studio's server: its own page, with the token."""

from __future__ import annotations

import hmac
from urllib.parse import urlsplit

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

_POLICY = (
    "default-src 'self'; img-src 'self' blob: data:; style-src 'self' 'unsafe-inline'; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'; object-src 'none'"
)
HEADERS = {
    "content-security-policy": _POLICY, "x-content-type-options": "nosniff", "referrer-policy": "no-referrer",
    "cache-control": "no-store", "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}  # fmt: skip
_REFUSED = 4403  # WebSocket close code, from the range for applications


class Guard:
    """Passes on requests for a known host, from its own page, with the token; the page's files need no token.

    Behind a proxy, `url` is the address at which browsers see the page: requests may come from a page there, for its
    host or the proxy's own idea of ours, with its path before ours or without it.
    """

    def __init__(self, app: ASGIApp, token: str, hosts: tuple[str, ...], url: str = "") -> None:
        self._app, self._token = app, token
        outside = urlsplit(url)
        self._origin, self._prefix = f"{outside.scheme}://{outside.netloc}", outside.path.rstrip("/")
        self._hosts = (*hosts, outside.netloc) if url else hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {key.decode("latin-1"): value.decode("latin-1") for key, value in scope["headers"]}
        if self._prefix and scope["path"].startswith(f"{self._prefix}/"):
            scope = {**scope, "path": scope["path"].removeprefix(self._prefix)}
        reason = self._refusal(headers, scope)
        if reason is None:
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": _REFUSED, "reason": reason})
        else:
            await PlainTextResponse(f"{reason}\n", 403, HEADERS)(scope, receive, send)

    def _refusal(self, headers: dict[str, str], scope: Scope) -> str | None:
        host = headers.get("host", "")
        if host.rpartition(":")[0] not in self._hosts and host not in self._hosts:
            return "the host is unknown: expected the address that the studio printed"
        origin = headers.get("origin")
        if origin not in (None, self._origin) and origin.partition("://")[2] != host:  # type: ignore[union-attr]
            return "the request comes from another page: expected the studio's own"
        if scope["path"].startswith("/assets/"):
            return None
        query = dict(part.partition("=")[::2] for part in scope["query_string"].decode("latin-1").split("&"))
        if not hmac.compare_digest(query.get("token", "").encode(), self._token.encode()):
            return "the token is missing or wrong: expected the address that the studio printed"
        return None
