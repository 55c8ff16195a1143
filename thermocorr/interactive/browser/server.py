"""The workbench in a browser: pages, pieces of curves, acts and files, on 127.0.0.1 alone."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
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
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from ...foreign.containers import FEATHER, PACKED, SHEETS
from ...records import RecordError
from ...records.files import FORMATS
from ..learning import sentence
from ..opening import Opening
from ..takeaway import KINDS
from . import page_assets
from .guard import Guard
from .hub import Changed, Hub, NotDone
from .pieces import NoSuchCurve, cloud_of, known_json, piece_of

AWAY = 10.0
"""Seconds without any page after which the workbench ends: a reload takes less."""
UNSEEN = 3600.0
"""Seconds after which it ends if no page was ever opened."""
BEAT = 15.0
"""Seconds after which a silent line to a page is used, to see whether it is there."""
MOST_ASKED = 1 << 16
"""Bytes of a request that is no file."""
LONGEST_PAUSE = 20.0
"""Time for which the next part of a request is waited for [s]."""
MOST_UPLOADED = 1 << 30
"""Bytes of a log that is dropped on the page."""
ENDINGS = (".csv", ".txt", ".tsv", ".dat", ".log", *FORMATS, *FEATHER, *SHEETS, *PACKED)


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
                Route("/api/do", self.do, methods=["POST"]),
                Route("/api/cancel", self.cancel, methods=["POST"]),
                Route("/api/open", self.open, methods=["POST"]),
                Route("/api/piece", self.piece),
                Route("/api/cloud", self.cloud),
                Route("/api/charts", self.charts),
                Route("/take/{kind}", self.take),
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
                    yield await asyncio.wait_for(page.get(), BEAT)
                    continue
                yield ": here\n\n"
        finally:
            self.hub.leave(page)

    async def do(self, request: Request) -> Response:
        """An act of the user."""
        asked = await _json(request)
        if isinstance(asked, str):
            return _failed(asked, 400)
        revision = asked.pop("revision", None)
        try:
            if asked.get("do") in ("preview", "fit"):  # they change nothing
                return JSONResponse(await self.hub.ask("do", asked))
            return JSONResponse(await self.hub.act(asked, revision))
        except Changed as changed:
            return _failed(str(changed), 409)
        except NotDone as refused:
            return _failed(str(refused), 422)

    async def cancel(self, request: Request) -> Response:
        """Stop what is being computed."""
        self.hub.cancel()
        return JSONResponse({})

    async def open(self, request: Request) -> Response:
        """A log that was dropped on the page, or a built-in record."""
        if "sample" in request.query_params:
            return await self._opened(
                Opening(sample=request.query_params["sample"], own_file=self.hub.opening.own_file)
            )
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
            return _failed(str(error) or "The file did not come whole.", 413 if too_large else 422)
        own = self.hub.opening.own_file
        return await self._opened(Opening(paths=(str(path),), names=(name,), own_file=own))

    async def _opened(self, opening: Opening) -> Response:
        try:
            await self.hub.open(opening)
        except NotDone as refused:
            said = str(refused)
            for path, name in zip(opening.paths, opening.names, strict=True):
                said = said.replace(path, name)
                shutil.rmtree(Path(path).parent, ignore_errors=True)
            return _failed(said, 422)
        return JSONResponse({})

    async def piece(self, request: Request) -> Response:
        """Some curves between two places."""
        return await _shown(lambda: piece_of(self.hub, request.query_params))

    async def cloud(self, request: Request) -> Response:
        """The residual over a curve."""
        return await _shown(lambda: cloud_of(self.hub, request.query_params))

    async def charts(self, request: Request) -> Response:
        """Charts of a fitted arrangement."""
        return JSONResponse(known_json(self.hub.charts.get(request.query_params.get("key", ""), [])))

    async def take(self, request: Request) -> Response:
        """A file to take away."""
        kind = request.path_params["kind"]
        try:
            path = await self.hub.ask("take", kind)
        except NotDone as refused:
            return _failed(str(refused), 422)
        clean = BackgroundTask(shutil.rmtree, Path(path).parent, ignore_errors=True)
        return FileResponse(path, media_type=KINDS[kind].media, filename=KINDS[kind].file, background=clean)


async def _broken(request: Request, error: Exception) -> Response:
    return _failed(f"The workbench has a fault: {sentence(error)}. Please report it.", 500)


async def _in_time(chunks: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    """Chunks of a request's body; TimeoutError where the next one does not come."""
    while True:
        try:
            yield await asyncio.wait_for(anext(chunks), LONGEST_PAUSE)
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


async def _shown(make: Callable[[], Any]) -> Response:
    try:
        return JSONResponse(await run_in_threadpool(make))
    except (NoSuchCurve, OSError):
        return _failed("These curves are no longer there.", 404)
    except ValueError as error:
        return _failed(str(error), 400)


async def _json(request: Request) -> dict[str, Any] | str:
    """The object that a request brings, or what is wrong with it."""
    if request.headers.get("content-type", "").split(";")[0] != "application/json":
        return "Only JSON is understood."
    content = b""
    try:
        async for chunk in _in_time(request.stream()):
            content += chunk
            if len(content) > MOST_ASKED:
                return "This is too much."
    except (ClientDisconnect, TimeoutError):
        return "The request did not come whole."
    try:
        found = json.loads(content)
    except (ValueError, RecursionError):
        return "This is not JSON."
    return found if isinstance(found, dict) else "An object was expected."


def _failed(sentence: str, status: int) -> Response:
    return JSONResponse({"problem": sentence}, status)


def run(opening: Opening, *, port: int = 0, keep: bool = False, ready: Callable[[str], None]) -> None:
    """Serve until the last page has closed, or a signal ends it.

    `opening` (Opening). `port` (int): 0 takes a free one. `keep` (bool): Go on when the last page has closed. `ready`
    (callable): Called with the address when there is something to be seen.
    """
    with socket.socket() as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            said = getattr(error, "strerror", None) or error
            raise RecordError(f"Port {port} cannot be had: {said}. Without --port a free one is taken.") from None
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
        if not keep and not hub.pages and alone > (AWAY if hub.seen else UNSEEN):
            server.should_exit = True
    bench.ended.set()
    for page in bench.hub.pages:
        with contextlib.suppress(asyncio.QueueFull):
            page.put_nowait("event: ended\ndata: {}\n\n")
