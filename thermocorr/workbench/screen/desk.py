"""Messages between a screen and a story, as JSON."""

from __future__ import annotations

import base64
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...model import DynamicBiasRegressor
from ...output.residual_displays import ResidualsDisplay
from ...readers import Options
from ...records import RecordError
from ...records.numbers import scale_of, span_text
from ..files import KINDS
from ..log import quiet
from ..state import figure, state_of
from ..story import Story, sentence

LOOKS = ("picture",)
"""Questions that are answered from what is known, and change nothing."""
WORDS = {"open": "reading the log", "do": "fitting the model", "take": "writing"}
NARROW, SMALL = 560, 270
"""Pixels of a telephone's width, and height of a picture over time on it."""
DOES = ("assign", "shape", "add", "leave_out", "drop", "undo", "redo", "judge", "preview")
"""What a screen may ask a story to do."""


@dataclass(frozen=True, kw_only=True)
class Opening:
    """Arguments with which a story is opened."""

    paths: tuple[str, ...] = ()
    """Files of the log; none for the built-in record."""
    names: tuple[str, ...] = ()
    """What they are called, if that is not their paths' ends."""
    how: Options = field(default_factory=Options)
    roles: dict[str, str] = field(default_factory=dict)
    model: dict[str, Any] = field(default_factory=dict)
    """Parameters of the model that the user has chosen."""
    effects_file: str = ""
    past: Any = None
    """What was done already: versions of acts, and which of them stands."""

    def story(self) -> Story:
        """The story, its log read; RecordError where that cannot be."""
        chosen = {name: value for name, value in self.model.items() if value is not None}
        story = Story.open(
            self.paths,
            self.how,
            names=self.names,
            effects_file=self.effects_file,
            roles=self.roles,
            model=DynamicBiasRegressor(**chosen),
            settled="time_constants" in chosen,
        )
        if self.past is not None:
            story.versions, story.at = self.past["versions"], self.past["at"]
        return story

    def remedy(self) -> str:
        """A button's text where a problem has a remedy, or ""."""
        if self.how.skip_bad_rows or not self.paths:
            return ""
        try:
            with quiet():
                story = replace(self, how=replace(self.how, skip_bad_rows=True), past=None).story()
        except (RecordError, OSError):
            return ""
        story.start()
        return (
            ""
            if story.problem and story.roles is not None
            else "Leave bad rows out, keep the first of doubled ones, sort by time"
        )


class Desk:
    """Answers the messages of a screen over any carrier.

    `story` (Story, optional): None until a log is opened. `tell` (callable): Sends a message to the screen. `chores`
    (bool): Find out at once, behind an answer, what is not known yet; else whoever carries the messages calls `chore`
    in between.
    """

    def __init__(self, story: Story | None, tell: Any, chores: bool = True):
        self.story, self.tell, self.chores = story, tell, chores
        self.opening = Opening()
        self.revision = 0
        self.later: Callable[[Callable[[], Any]], Any] | None = None
        """Calls something when the messages that have come are answered, where there is what does that."""
        self._shown: dict[str, Any] = {}

    def carried(self, work: Callable[[], None], chore: bool = False) -> bool:
        """Do some work; False if it was cancelled."""
        work()
        return True

    def _story(self) -> Story:
        if self.story is None:
            raise RecordError("No log is open yet, or it is still being read.")
        return self.story

    def show(self, again: bool = False) -> None:
        """Tell the screen all that it shows, where that is news."""
        if self.story is None:
            return
        remedy = self.opening.remedy() if self.story.problem and self.story.roles is not None else ""
        shown = {**state_of(self.story), "trouble": "", "remedy": remedy}
        if again or shown != self._shown:
            self.revision += 1
            self._shown = shown
            self.tell({"kind": "state", "content": {**shown, "revision": self.revision}})

    def progress(self, text: str) -> None:
        """Tell the screen what is being done."""
        self.tell({"kind": "progress", "content": {"text": text}})

    def chore(self) -> bool:
        """Find out one thing; False if nothing is left."""
        found = None if self.story is None else self.story.next_chore()
        if found is None or self.story is None:
            self.progress("")
            return False
        words, work = found
        self.progress(words)
        self.story.progress = lambda text: self.progress(f"{words}: {text}")
        if not self.carried(work, chore=True):
            self.stop()
        self.show()
        return True

    def stop(self) -> None:
        """Stop finding out until the user asks."""
        found = None if self.story is None else self.story.now
        if found is not None and found.diagnosis is None:
            found.lacking = found.lacking or "Stopped. Judge again to go on."

    def hear(self, message: dict[str, Any]) -> None:
        """Answer a message: ready, open, remedy, do, picture or take."""
        what, number, given = str(message.get("what")), message.get("number"), message.get("given") or {}
        if what in WORDS:
            self.progress(WORDS[what])
        before = None if self.story is None else (self.story, self.story.at, len(self.story.versions))
        answers: list[Any] = []

        def work() -> None:
            answers.append(self._answer(what, given))

        try:
            if what in LOOKS:
                work()
            elif not self.carried(work):
                now = None if self.story is None else (self.story, self.story.at, len(self.story.versions))
                if now == before:
                    raise RecordError("Cancelled: everything stands as it was.")
        except Exception as error:  # effects of the user's own raise whatever they like
            remedy = self.opening.remedy() if what == "open" else ""
            self.tell({"kind": "failed", "number": number, "problem": sentence(error), "remedy": remedy})
            return
        if what not in LOOKS:
            self.show(again=what == "ready")
        self.tell({"kind": "done", "number": number, "content": known_json(answers[0] if answers else {})})
        if what in ("ready", "open", "remedy", "do"):
            self._go_on()

    def _go_on(self) -> None:
        """Find out what is unknown, message by message."""
        if self.later is not None:
            self.later(self._one)
            return
        while self.chores and self.chore():
            pass

    def _one(self) -> None:
        if self.chore():
            self._go_on()

    def _answer(self, what: str, given: Any) -> Any:
        if what in ("open", "remedy"):
            return self._open(given)
        story = self._story()
        if what == "ready":
            if story.now is None:
                story.start()
            return {}
        if what == "do":
            return self._do(story, dict(given))
        if what == "picture":
            return self._picture(story, dict(given))
        if what == "take":
            kind = str(given.get("kind"))
            content = base64.b64encode(story.export(kind)).decode()
            return {"name": KINDS[kind].name, "media": KINDS[kind].media, "content": content}
        raise ValueError(f"{what!r} is not known here.")

    def _do(self, story: Story, given: dict[str, Any]) -> dict[str, Any]:
        """One of `DOES`, its arguments by their names."""
        name, _ = given.pop("do", None), given.pop("revision", None)
        if name not in DOES:
            raise ValueError(f"{name!r:.40} cannot be done here.")
        if name == "judge":  # a chore does it
            if story.now is not None:
                story.now.lacking = ""
            return {}
        try:
            found = getattr(story, name)(**given)
        except TypeError as error:
            raise ValueError(f"{name} needs something else: {error}.") from None
        if name == "preview" and story.now is not None:
            scale = scale_of([found["before"], found["after"]], story.now.model.reading_.unit)
            return {"label": found["label"], **{end: figure(found[end], scale) for end in ("before", "after")}}
        return {"past": {"versions": story.versions, "at": story.at}}

    def _picture(self, story: Story, given: dict[str, Any]) -> dict[str, Any]:
        """A picture as SVG, and where its time axis lies."""
        name, width = str(given.pop("name", "")), given.pop("width", 900)
        width = min(max(width, 280), 2400) if type(width) in (int, float) and math.isfinite(width) else 900
        height = SMALL if name == "time" and width < NARROW else None
        if name == "time":  # one cell for a pixel
            given["cells"] = int(width)
        display = story.display(name, **given)
        if display is None:
            return {"svg": ""}
        svg = display.to_svg(width, height)
        box = display.ax_.get_position()
        return {"svg": svg, "left": box.x0, "right": box.x1, "points": _points(display)}

    def _open(self, given: Any) -> dict[str, Any]:
        """Open a log, or the last one without bad rows."""
        idle = False
        if not isinstance(given, Opening):
            idle = bool(given.get("idle"))
            if given.get("remedy"):
                how = replace(self.opening.how, skip_bad_rows=True)
                given = replace(self.opening, how=how, past=None)
            else:
                path = str(given.get("path") or "")
                paths, names = ((path,), (Path(path).name,)) if path else ((), ())
                given = Opening(
                    paths=paths, names=names, past=given.get("past"), effects_file=self.opening.effects_file
                )
        self.opening = given
        story = given.story()
        story.start()
        self.story = story
        if idle:
            self.stop()
        return {"past": {"versions": story.versions, "at": story.at}}


def _points(display: Any) -> list[list[Any]]:
    """Words for each cell of a picture over time."""
    if not isinstance(display, ResidualsDisplay):
        return []
    cells, line = display.cells, display.timeline
    seconds = cells["seconds"].to_numpy()
    places = seconds + line.shifts[cells["segment"].to_numpy()]
    when = line.times(seconds)
    if line.dates:
        times = list(when.strftime("%Y-%m-%d %H:%M:%S"))
    else:
        times = [f"sample {value:.0f}" if line.samples else span_text(value, 6) for value in when]
    columns = [cells[name].to_numpy() for name in ("measured", "modelled", "residual")]
    scales = [scale_of(np.nanmax(np.abs(column), initial=0.0), display.unit) for column in columns]
    said = [[scale.text(value, 6) for value in column] for scale, column in zip(scales, columns, strict=True)]
    return [list(row) for row in zip(places.tolist(), times, *said, strict=True)]


def known_json(node: Any) -> Any:
    """JSON without NaN and infinities, which it does not have."""
    if isinstance(node, float):
        return node if math.isfinite(node) else None
    if isinstance(node, dict):
        return {key: known_json(value) for key, value in node.items()}
    return [known_json(value) for value in node] if isinstance(node, list | tuple) else node
