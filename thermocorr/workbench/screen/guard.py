"""Who may talk to the workbench: this machine's user in the browser that was given the address, and nobody else."""

from __future__ import annotations

import hmac
import secrets

from starlette.datastructures import Headers, MutableHeaders, QueryParams
from starlette.requests import cookie_parser
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Guard:
    """Lets requests through that bear the cookie, to the right host, from no other site.

    The address that the command prints has a token, which is good for one visit: it is exchanged for a cookie that no
    script can read and no other site can send. Names other than 127.0.0.1 and localhost are refused, so that a foreign
    name that leads here (DNS rebinding) reaches nothing.

    `app` (ASGI application). `port` (int).
    """

    def __init__(self, app: ASGIApp, port: int):
        self.app = app
        self.hosts = (f"127.0.0.1:{port}", f"localhost:{port}")
        self.token: str | None = secrets.token_urlsafe(32)
        """Good for one visit; None when that has been."""
        self.cookie = f"thermocorr-{port}"
        self._secret = secrets.token_urlsafe(32)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or pass on."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return

        async def sealed(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        answer = self._stopped(scope)
        await (answer or self.app)(scope, receive, sealed)

    def _stopped(self, scope: Scope) -> Response | None:
        """The answer to who may not pass; None for who may."""
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if host not in self.hosts:
            return _refused("This is not the address of the workbench.")
        origin = headers.get("origin")
        if origin is not None and origin != f"http://{host}":
            return _refused("Another site may not use the workbench.")
        query = QueryParams(scope.get("query_string", b""))
        if "token" in query and scope["path"] == "/" and scope["method"] == "GET":
            return self._exchanged(query["token"], self._known(headers))
        # What a browser says of where a request comes from, if it is this page or the address bar
        if headers.get("sec-fetch-site") not in (None, "same-origin", "none"):
            return _refused("Another site may not use the workbench.")
        if scope["method"] not in ("GET", "HEAD") and origin is None:
            return _refused("Only the page of the workbench may do this.")
        if not self._known(headers):
            return _refused(
                "Open the address that the command printed: it is good for one visit, in one browser. To look from "
                "another one, start the workbench anew."
            )
        return None

    def _exchanged(self, token: str, known: bool) -> Response:
        answer = RedirectResponse("/", 303)
        if known:
            return answer
        if self.token is None or not hmac.compare_digest(token.encode(), self.token.encode()):
            return _refused("This address was used already, or is not complete. Start the workbench anew.")
        self.token = None
        answer.set_cookie(self.cookie, self._secret, httponly=True, samesite="strict", path="/")
        return answer

    def _known(self, headers: Headers) -> bool:
        given = cookie_parser(headers.get("cookie", "")).get(self.cookie, "")
        return hmac.compare_digest(given.encode(), self._secret.encode())


def _refused(sentence: str) -> Response:
    return PlainTextResponse(f"{sentence}\n", 403)
