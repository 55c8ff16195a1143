"""The workbench on 127.0.0.1, for this user's browser alone."""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import json
import re
import secrets
import shutil
import signal
import socket
import sys
import tempfile
import threading
import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders, QueryParams
from starlette.requests import ClientDisconnect, Request, cookie_parser
from starlette.responses import (
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    RedirectResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ...readers.log import FRAMES
from ...records import RecordError
from ..story import sentence
from . import page_assets
from .desk import LOOKS, Opening
from .hub import Changed, Hub, NotDone

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
    """Let requests through with the cookie, host and site.

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
        # A browser says where a request comes from: this page, or the address bar.
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


UNSEEN = 3600.0
"""Seconds after which it ends if no page was ever opened."""
MOST_UPLOADED = 1 << 30
"""Bytes of a log that is dropped on the page."""
SAID = ("do", "take", *LOOKS)
"""What a page may say to the desk."""
ENDINGS = (".csv", ".txt", ".tsv", ".dat", ".log", ".gz", ".zip", *FRAMES)


class TooLarge(ValueError):
    """A file is larger than what is taken from a page."""


class Workbench:
    """The routes of a workbench.

    `hub` (Hub).
    """

    def __init__(self, hub: Hub):
        self.hub = hub
        self.ended = asyncio.Event()

    def app(self) -> Starlette:
        """The application, with all routes."""
        return Starlette(
            routes=[
                Route("/", self.page),
                Route("/assets/{name}", self.asset),
                Route("/events", self.events),
                Route("/api/say", self.say, methods=["POST"]),
                Route("/api/cancel", self.cancel, methods=["POST"]),
                Route("/api/open", self.open, methods=["POST"]),
            ],
            exception_handlers={Exception: _broken},
        )

    async def page(self, request: Request) -> Response:
        """The page itself."""
        return HTMLResponse(page_assets.page())

    async def asset(self, request: Request) -> Response:
        """A script or a style, of those that there are."""
        name = request.path_params["name"]
        if name not in page_assets.ASSETS:
            return Response(status_code=404)
        return Response(page_assets.asset_text(name), media_type=page_assets.ASSETS[name])

    async def events(self, request: Request) -> Response:
        """Everything that changes, as it changes."""
        return StreamingResponse(self._events(), media_type="text/event-stream")

    async def _events(self) -> AsyncIterator[str]:
        page = self.hub.enter()
        try:
            while not self.ended.is_set() and page in self.hub.pages:
                with contextlib.suppress(TimeoutError):
                    # After 15 s of silence something is sent to a page, to see whether it is there.
                    yield await asyncio.wait_for(page.get(), 15.0)
                    continue
                yield ": here\n\n"
        finally:
            self.hub.leave(page)

    async def say(self, request: Request) -> Response:
        """A message to the desk, and its answer; an act names the ``revision`` of the state that it is meant for."""
        message = await _json(request)
        if isinstance(message, str):
            return _failed(message, 400)
        what, given = message.get("what"), message.get("given")
        if what not in SAID or not isinstance(given, dict):
            return _failed(f"A message says what ({', '.join(SAID)}) and what is given (an object).", 400)
        revision = given.pop("revision", None)
        try:
            if what == "do" and given.get("do") != "preview":  # which change nothing
                return JSONResponse(await self.hub.act(given, revision))
            return JSONResponse(await self.hub.ask(what, given))
        except NotDone as refused:
            return _failed(str(refused), 409 if isinstance(refused, Changed) else 422)

    async def cancel(self, request: Request) -> Response:
        """Stop what is being computed."""
        self.hub.cancel()
        return JSONResponse({})

    async def open(self, request: Request) -> Response:
        """A log that was dropped on the page; or the last one again, without its bad rows."""
        if "remedy" in request.query_params:
            try:
                await self.hub.mend()
            except NotDone as refused:
                return _failed(str(refused), 422)
            return JSONResponse({})
        name = Path(request.query_params.get("name", "log.csv").replace("\\", "/")).name
        name = re.sub(r"[^\w .()+-]|^\.", "_", name)[-100:]
        ending = Path(name).suffix.lower()
        if ending not in ENDINGS:
            said = f"A file that ends in {ending[:12]}" if ending else "A file without an ending"
            return _failed(f"{said} is no log. Known: {', '.join(ENDINGS)}.", 422)
        path = Path(tempfile.mkdtemp(prefix="upload-", dir=self.hub.folder)) / name
        try:
            await _received(request, path)
        except (ValueError, OSError, ClientDisconnect) as error:  # a TimeoutError is an OSError
            shutil.rmtree(path.parent, ignore_errors=True)
            too_large = isinstance(error, TooLarge)
            return _failed(str(error) or "The file did not arrive completely.", 413 if too_large else 422)
        own = self.hub.opening.effects_file
        try:
            await self.hub.open(Opening(paths=(str(path),), names=(name,), effects_file=own))
        except NotDone as refused:
            return _failed(str(refused).replace(str(path), name), 422, refused.remedy)
        return JSONResponse({})


async def _broken(request: Request, error: Exception) -> Response:
    return _failed(f"The workbench has a fault: {sentence(error)}. Please report it.", 500)


async def _in_time(chunks: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    """Chunks of a request's body; TimeoutError where the next one does not come."""
    while True:
        try:
            # The next part of a request is waited for, up to 20 s.
            yield await asyncio.wait_for(anext(chunks), 20.0)
        except StopAsyncIteration:
            return


async def _received(request: Request, path: Path) -> None:
    """Write the body of a request to a file; raises TooLarge as soon as that is known."""
    too_large = TooLarge(f"The file is larger than {MOST_UPLOADED >> 20} MiB. Give its name to the command instead.")
    if int(request.headers.get("content-length", "0")) > MOST_UPLOADED:
        raise too_large
    with path.open("wb") as file:
        async for chunk in _in_time(request.stream()):
            if file.tell() + len(chunk) > MOST_UPLOADED:
                raise too_large
            await run_in_threadpool(file.write, chunk)


async def _json(request: Request) -> dict[str, Any] | str:
    """The object that a request brings, or what is wrong with it."""
    if request.headers.get("content-type", "").split(";")[0] != "application/json":
        return "Only JSON is understood."
    content = b""
    try:
        async for chunk in _in_time(request.stream()):
            content += chunk
            # A request that is no file is short.
            if len(content) > (1 << 16):
                return "This is too much."
    except (ClientDisconnect, TimeoutError):
        return "The request did not arrive completely."
    try:
        found = json.loads(content)
    except (ValueError, RecursionError):
        return "This is not JSON."
    return found if isinstance(found, dict) else "An object was expected."


def _failed(sentence: str, status: int, remedy: str = "") -> Response:
    return JSONResponse({"problem": sentence, "remedy": remedy}, status)


def run(opening: Opening, *, port: int = 0, keep: bool = False, ready: Callable[[str], None]) -> None:
    """Serve until the last page closes.

    `opening` (Opening). `port` (int): 0 takes a free one. `keep` (bool): Go on when the last page has closed. `ready`
    (callable): Called with the address when there is something to be seen.
    """
    with socket.socket() as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            said = getattr(error, "strerror", None) or error
            raise RecordError(f"Port {port} is not free: {said}. Without --port a free one is taken.") from None
        listening.listen(2048)  # who comes a moment too early waits
        hub = Hub(opening)
        try:
            hub.start("fork" if sys.platform == "linux" and threading.active_count() == 1 else "spawn")
            asyncio.run(_served(hub, listening, keep, ready))
        finally:
            for number in (signal.SIGINT, signal.SIGTERM):  # nothing is left half removed
                signal.signal(number, signal.SIG_IGN)
            hub.stop()


async def _served(hub: Hub, listening: socket.socket, keep: bool, ready: Callable[[str], None]) -> None:
    port = listening.getsockname()[1]
    bench = Workbench(hub)
    guard = Guard(bench.app(), port)
    server = uvicorn.Server(
        uvicorn.Config(
            guard, log_level="error", access_log=False, lifespan="off", ws="none", server_header=False,
            timeout_graceful_shutdown=2,
        )
    )  # fmt: skip
    hub.listen()
    if hasattr(signal, "SIGHUP"):
        asyncio.get_running_loop().add_signal_handler(signal.SIGHUP, setattr, server, "should_exit", True)
    watching = asyncio.create_task(_watch(server, bench, keep))
    ready(f"http://127.0.0.1:{port}/?token={guard.token}")
    try:
        await server.serve([listening])
    finally:
        watching.cancel()


async def _watch(server: uvicorn.Server, bench: Workbench, keep: bool) -> None:
    """End the server when the last page has been closed for a while; let lines to pages end with it."""
    while not server.should_exit:
        await asyncio.sleep(0.2)
        hub = bench.hub
        alone = time.monotonic() - hub.left
        # The workbench ends ten seconds after its last page: a reload takes less.
        if not keep and not hub.pages and alone > (10.0 if hub.seen else UNSEEN):
            server.should_exit = True
    bench.ended.set()
    for page in bench.hub.pages:
        with contextlib.suppress(asyncio.QueueFull):
            page.put_nowait("event: ended\ndata: {}\n\n")
