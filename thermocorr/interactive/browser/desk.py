"""What a screen asks, and what it is told: messages of JSON, whatever carries them."""

from __future__ import annotations

import base64
import shutil
from pathlib import Path
from typing import Any

from ...records import RecordError
from ..bench import Bench
from ..learning import sentence
from ..opening import Opening
from ..snapshots import snapshot
from ..takeaway import KINDS, is_session, past_node, taken
from ..tiles import Store, Tiles
from .pieces import NoSuchCurve, cloud_of, known_json, piece_of


class Desk:
    """What a screen asks and is told, whatever carries the messages: a notebook's kernel, or a browser's worker.

    `bench` (Bench, optional): None until a log is opened. `tell` (callable): Sends a message to the screen. `store`
    (Store): Where the curves of a log that is opened later are put; that of the bench by default. `chores` (bool): Find
    out at once, behind an answer, what is not known yet; else whoever carries the messages calls `chore` in between.
    """

    def __init__(self, bench: Bench | None, tell: Any, store: Store | None = None, chores: bool = True):
        self.bench, self.tell = bench, tell
        found = store or (None if bench is None else bench.store)
        assert found is not None
        self.store, self.tiles = found, Tiles(found)
        self.revision, self.chores, self.idle = 0, chores, False
        """`idle`: whether nothing is found out until the next act, as after a cancelled one."""

    @property
    def curves(self) -> dict[str, dict[str, str]]:
        """Names of curves in the store, by the keys of arrangements."""
        return {key: found.curves for key, found in self._bench().kept.items()}

    def _bench(self) -> Bench:
        if self.bench is None:
            raise RecordError("No log is open yet.")
        return self.bench

    def show(self) -> None:
        """Tell the screen all that it shows."""
        self.revision += 1
        bench = self._bench()
        found = bench.current
        charts = [found.arrangement.key()] if found is not None and found.charts is not None else []
        state = {**snapshot(bench), "revision": self.revision, "trouble": "", "charts": charts}
        self.tell({"kind": "state", "content": state})

    def chore(self) -> bool:
        """Find out one thing that is not known yet; False where nothing is left."""
        found = None if self.bench is None or self.idle else self.bench.next_chore()
        if found is not None:
            self.tell({"kind": "progress", "content": {"text": found[0]}})
            found[1]()
            self.show()
        if found is None or self.bench is None or self.bench.next_chore() is None:
            self.tell({"kind": "progress", "content": {"text": ""}})
        return found is not None

    def hear(self, message: dict[str, Any]) -> None:
        """Answer a message: ``what`` is ready, open, do, piece, cloud, charts or take; its ``number`` comes along."""
        what, number, given = message.get("what"), message.get("number"), message.get("given") or {}
        try:
            answer = self._answer(str(what), given)
        except Exception as error:  # effects of the user's own raise whatever they like
            gone = isinstance(error, NoSuchCurve)
            problem = "These curves are no longer there." if gone else sentence(error)
            self.tell({"kind": "failed", "number": number, "problem": problem})
            return
        self.tell({"kind": "done", "number": number, "content": known_json(answer)})
        if what in ("ready", "open", "do"):
            self.show()
            while self.chores and self.chore():
                pass

    def _answer(self, what: str, given: dict[str, Any]) -> Any:
        if what == "open":
            return self._open(given)
        bench = self._bench()
        if what == "ready":
            if bench.current is None:
                bench.start()
            return {}
        if what == "do":
            self.idle = False
            return {**bench.perform(given), "past": past_node(bench.past)}
        if what == "piece":
            return piece_of(self, given)
        if what == "cloud":
            return cloud_of(self, given)
        if what == "charts":
            found = bench.kept.get(str(given.get("key")))
            return (found.charts if found else None) or []
        if what == "take":
            path = taken(bench, str(given.get("kind")), Path(bench.store.folder))
            content = base64.b64encode(path.read_bytes()).decode()
            shutil.rmtree(path.parent, ignore_errors=True)
            return {"name": path.name, "media": KINDS[str(given["kind"])].media, "content": content}
        raise ValueError(f"{what!r} is not known here.")

    def _open(self, given: dict[str, Any]) -> dict[str, Any]:
        """Put a log on the desk: a file by its ``path``, or a built-in ``sample``; with the ``past`` of its steps."""
        path = str(given.get("path") or "")
        session = path if path and is_session(path) else ""
        opening = Opening(
            paths=(path,) if path and not session else (),
            names=(Path(path).name,) if path and not session else (),
            sample=str(given.get("sample") or ""),
            session=session,
            past=given.get("past"),
        )
        bench = opening.bench(self.store)
        bench.start()
        self.bench, self.idle = bench, bool(given.get("idle"))
        return {"past": past_node(bench.past)}
