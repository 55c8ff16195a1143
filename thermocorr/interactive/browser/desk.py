"""Messages between a screen and the workbench, as JSON, whatever carries them."""

from __future__ import annotations

import base64
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...records import RecordError
from ..bench import Bench
from ..learning import sentence
from ..opening import Opening
from ..snapshots import snapshot
from ..takeaway import KINDS, past_node, taken
from ..tiles import Store, Tiles
from .pieces import NoSuchCurve, cloud_of, known_json, piece_of

LOOKS = ("piece", "cloud", "charts")
"""Questions that are answered from what is known, and change nothing."""
WORDS = {"open": "reading the log", "do": "fitting the model", "take": "writing"}


class Desk:
    """Answers the messages of a screen, whatever carries them: a kernel, a browser's worker, or a process.

    `bench` (Bench, optional): None until a log is opened. `tell` (callable): Sends a message to the screen. `store`
    (Store): Where the curves of a log that is opened later are put; that of the bench by default. `chores` (bool): Find
    out at once, behind an answer, what is not known yet; else whoever carries the messages calls `chore` in between.
    """

    def __init__(self, bench: Bench | None, tell: Any, store: Store | None = None, chores: bool = True):
        self.bench, self.tell = bench, tell
        found = store or (None if bench is None else bench.store)
        assert found is not None
        self.store, self.tiles = found, Tiles(found)
        self.revision, self.chores, self.own_file = 0, chores, ""
        self._shown: dict[str, Any] = {}

    def carried(self, work: Callable[[], None], chore: bool = False) -> bool:
        """Do some work; whether it came to its end, and was not cancelled."""
        work()
        return True

    def _bench(self) -> Bench:
        if self.bench is None:
            raise RecordError("No log is open yet, or it is still being read.")
        return self.bench

    def show(self, again: bool = False) -> None:
        """Tell the screen all that it shows, where that is news."""
        if self.bench is None:
            return
        found = self.bench.current
        charts = [found.arrangement.key()] if found is not None and found.charts is not None else []
        shown = {**snapshot(self.bench), "trouble": "", "charts": charts}
        if again or shown != self._shown:
            self.revision += 1
            self._shown = shown
            self.tell({"kind": "state", "content": {**shown, "revision": self.revision}})

    def progress(self, text: str) -> None:
        """Tell the screen what is being done."""
        self.tell({"kind": "progress", "content": {"text": text}})

    def chore(self) -> bool:
        """Find out one thing that is not known yet; False where nothing is left."""
        found = None if self.bench is None else self.bench.next_chore()
        if found is None:
            self.progress("")
            return False
        self.progress(found[0])
        if not self.carried(found[1], chore=True):
            self.stop()
        self.show()
        return True

    def stop(self) -> None:
        """Leave unknown what is not known yet, until the user asks for it."""
        found = None if self.bench is None else self.bench.current
        if found is not None:
            for name in ("errors", "diagnosis"):
                found.said.setdefault(name, "Stopped. Judge again to go on.")
            found.charts = found.charts or []

    def hear(self, message: dict[str, Any]) -> None:
        """Answer a message: ``what`` is ready, open, do, piece, cloud, charts or take; its ``number`` comes along."""
        what, number, given = str(message.get("what")), message.get("number"), message.get("given") or {}
        if what in WORDS:
            self.progress(WORDS[what])
        before = None if self.bench is None else self.bench.past
        answers: list[Any] = []

        def work() -> None:
            answers.append(self._answer(what, given))

        try:
            if what in LOOKS:
                work()
            elif not self.carried(work) and (self.bench is None or self.bench.past is before):
                raise RecordError("Cancelled: everything stands as it was.")
        except Exception as error:  # effects of the user's own raise whatever they like
            gone = isinstance(error, NoSuchCurve) or (what in LOOKS and isinstance(error, OSError))
            problem = "These curves are no longer there." if gone else sentence(error)
            self.tell({"kind": "failed", "number": number, "problem": problem, "gone": gone})
            return
        if what not in LOOKS:
            self.show(again=what == "ready")
        self.tell({"kind": "done", "number": number, "content": known_json(answers[0] if answers else {})})
        if what in ("ready", "open", "do"):
            while self.chores and self.chore():
                pass

    def _answer(self, what: str, given: Any) -> Any:
        if what == "open":
            return self._open(given)
        bench = self._bench()
        if what == "ready":
            if bench.current is None:
                bench.start()
            return {}
        if what == "do":
            return {**bench.perform(given), "past": past_node(bench.past)}
        if what in ("piece", "cloud"):
            found = bench.kept.get(str(given.get("key")))
            if found is None:
                raise NoSuchCurve(given.get("key"))
            return (piece_of if what == "piece" else cloud_of)(self.tiles, found.curves, given)
        if what == "charts":
            found = bench.kept.get(str(given.get("key")))
            return (found.charts if found else None) or []
        if what == "take":
            path = taken(bench, str(given.get("kind")), Path(self.store.folder))
            content = base64.b64encode(path.read_bytes()).decode()
            shutil.rmtree(path.parent, ignore_errors=True)
            return {"name": path.name, "media": KINDS[str(given["kind"])].media, "content": content}
        raise ValueError(f"{what!r} is not known here.")

    def _open(self, given: Any) -> dict[str, Any]:
        """Put a log on the desk: an Opening, or a ``path`` or built-in ``sample``, with the ``past`` of its steps."""
        idle = False
        if not isinstance(given, Opening):
            path, idle = str(given.get("path") or ""), bool(given.get("idle"))
            given = Opening(
                paths=(path,) if path else (),
                names=(Path(path).name,) if path else (),
                sample=str(given.get("sample") or ""),
                past=given.get("past"),
                own_file=self.own_file,
            )
        self.own_file = given.own_file
        bench = given.bench(self.store)
        if self.bench is not None:  # its curves stay until the other one stands
            bench.needed = frozenset(name for found in self.bench.kept.values() for name in found.curves.values())
        bench.start()
        self.bench, bench.needed = bench, frozenset()
        if idle:
            self.stop()
        return {"past": past_node(bench.past)}
