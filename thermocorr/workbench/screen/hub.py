"""Between pages and the computing process."""

from __future__ import annotations

import asyncio
import contextlib
import json
import multiprocessing
import shutil
import tempfile
import threading
import time
import warnings
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from .desk import Opening
from .worker import serve

DIED = "The computation ended, perhaps for lack of memory. It begins again from the steps that stand."
GIVEN_UP = "The computation ends again and again, perhaps for lack of memory. Open a shorter log."
QUICK_DEATHS = 3
"""Ends of the process within a minute, after which it is not begun again."""


class NotDone(Exception):
    """A refused act: a sentence, and a remedy's button."""

    def __init__(self, problem: str, remedy: str = ""):
        super().__init__(problem)
        self.remedy = remedy


class Changed(NotDone):
    """The state is another one than the page has seen."""


class Hub:
    """One workbench, on the server's side.

    `opening` (Opening).
    """

    def __init__(self, opening: Opening):
        self.opening = self._tried = opening
        self.folder = Path(tempfile.mkdtemp(prefix="thermocorr-"))
        self.state: dict[str, Any] = {}
        self.revision = 0
        self.progress = "starting"
        self.pages: set[asyncio.Queue[str]] = set()
        self.seen = False
        """True if a page was ever open."""
        self.left = time.monotonic()
        """When the last page closed."""
        self._asked: dict[int, asyncio.Future[Any]] = {}
        self._number = 0
        self._past: Any = None
        self._turn = asyncio.Lock()
        self._deaths: list[float] = []
        self._process: Any = None
        self._pipe: Connection | None = None

    # ------------------------------------------------------------------------------------------------------ the process

    def start(self, method: str = "spawn") -> None:
        """Start the process, or restart it from its steps.

        `method` ({"spawn", "fork"}): Forking is quick, as all modules are loaded; it needs a process without threads.
        """
        context: Any = multiprocessing.get_context(method)
        self._pipe, other = context.Pipe()
        opening = replace(self.opening, past=self._past)
        not_its_own = self._pipe if method == "fork" else None
        self._process = context.Process(target=serve, args=(other, str(self.folder), opening, not_its_own), daemon=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # libraries' threads, which have nothing to do yet
            self._process.start()
        other.close()

    def listen(self) -> None:
        """Hear the process, from the event loop."""
        loop = asyncio.get_running_loop()
        threading.Thread(target=self._listen, args=(self._pipe, loop), daemon=True).start()

    def _listen(self, pipe: Connection, loop: asyncio.AbstractEventLoop) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            while True:
                try:
                    message = pipe.recv()
                except (EOFError, OSError, TypeError, ValueError):  # closed at one end or the other
                    loop.call_soon_threadsafe(self._died, pipe)
                    return
                loop.call_soon_threadsafe(self._hear, message)

    def _hear(self, message: dict[str, Any]) -> None:
        kind = message["kind"]
        if kind == "state":
            self._show(message["content"])
        elif kind == "progress":
            if message["content"]["text"] != self.progress:
                self.progress = message["content"]["text"]
                self._tell("progress", message["content"])
        else:
            future = self._asked.pop(message["number"], None)
            if isinstance(message.get("content"), dict):
                self._past = message["content"].get("past", self._past)
            if future is None:
                if kind == "failed":  # of the opening
                    self._complain(message["problem"], message.get("remedy", ""))
            elif not future.done():
                if kind == "done":
                    future.set_result(message["content"])
                else:
                    future.set_exception(NotDone(message["problem"], message.get("remedy", "")))

    def _show(self, state: dict[str, Any]) -> None:
        self.revision += 1
        self.state = {**state, "revision": self.revision}
        self._tell("state", self.state)

    def _complain(self, trouble: str, remedy: str = "") -> None:
        self._show({**self.state, "trouble": trouble, "remedy": remedy})

    def _died(self, pipe: Connection) -> None:
        if pipe is not self._pipe:
            return  # stopped on purpose
        self._process.join(1)
        for future in self._asked.values():
            if not future.done():
                future.set_exception(NotDone(DIED))
        self._asked.clear()
        now = time.monotonic()
        self._deaths = [*(death for death in self._deaths if now - death < 60), now]
        if len(self._deaths) >= QUICK_DEATHS:
            self.progress = ""
            self._complain(GIVEN_UP)
            return
        self._complain(DIED)
        self.start()
        self.listen()

    def stop(self) -> None:
        """End the process, and remove what it has written."""
        self._pipe = None
        if self._process is not None:
            self._process.kill()  # it holds nothing that is to be kept
            self._process.join(5)
        shutil.rmtree(self.folder, ignore_errors=True)

    # ------------------------------------------------------------------------------------------------ what is asked

    async def ask(self, what: str, given: Any) -> Any:
        """What the process answers; raises NotDone with its sentence."""
        if self._pipe is None or self._process is None or not self._process.is_alive():
            raise NotDone(DIED if len(self._deaths) < QUICK_DEATHS else GIVEN_UP)
        self._number += 1
        future = self._asked[self._number] = asyncio.get_running_loop().create_future()
        try:
            self._pipe.send({"what": what, "number": self._number, "given": given})
        except OSError:
            raise NotDone(DIED) from None
        except RecursionError:
            del self._asked[self._number]
            raise NotDone("This is nested too deeply.") from None
        return await future

    async def act(self, asked: dict[str, Any], revision: Any) -> Any:
        """Do something to the state of a revision; raises Changed where it is another one by now."""
        async with self._turn:
            if revision is not None and revision != self.revision:
                raise Changed("Another window has changed this meanwhile. Look, and try again.")
            return await self.ask("do", asked)

    async def open(self, opening: Opening) -> None:
        """Open another log."""
        async with self._turn:
            earlier, self._tried = {*self._tried.paths, *self.opening.paths}, opening
            if len(self._deaths) >= QUICK_DEATHS:  # given up: begin afresh, with this log
                self._deaths, self._past, self.opening = [], None, opening
                self.start()
                self.listen()
            else:
                await self.ask("open", opening)
                self.opening = opening
        for path in earlier - {*opening.paths}:
            if self.folder in Path(path).parents:  # was dropped on the page
                shutil.rmtree(Path(path).parent, ignore_errors=True)

    async def mend(self) -> None:
        """Read the log that was opened last again, without its bad rows."""
        async with self._turn:
            await self.ask("remedy", {"remedy": True})
            self.opening = self._tried = replace(self._tried, how=replace(self._tried.how, skip_bad_rows=True))

    def cancel(self) -> None:
        """Stop what is being computed."""
        if self._pipe is not None:
            with contextlib.suppress(OSError):
                self._pipe.send(None)

    # ------------------------------------------------------------------------------------------------------- the pages

    def enter(self) -> asyncio.Queue[str]:
        """A page opens: its queue, with all it must know."""
        # A page that has not read 64 messages is let go.
        page: asyncio.Queue[str] = asyncio.Queue(64)
        self.pages.add(page)
        self.seen = True
        page.put_nowait(event("state", self.state))
        page.put_nowait(event("progress", {"text": self.progress}))
        return page

    def leave(self, page: asyncio.Queue[str]) -> None:
        """A page has closed."""
        self.pages.discard(page)
        self.left = time.monotonic()

    def _tell(self, kind: str, content: dict[str, Any]) -> None:
        for page in list(self.pages):
            if page.full():  # it does not read: when it comes again it gets everything
                self.leave(page)
                continue
            page.put_nowait(event(kind, content))


def event(kind: str, content: dict[str, Any]) -> str:
    """A server-sent event."""
    return f"event: {kind}\ndata: {json.dumps(content, allow_nan=False)}\n\n"
