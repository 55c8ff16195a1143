"""Full disks: at every call that needs space, at every size of a file, and on a real file system of a few pages."""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import os
import random
import shutil
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from thermocorr import save_model
from thermocorr.pages.report import write_report

from .calls import Disturbance
from .children import Ended
from .episodes import Analyze, Episode, Export, Followed, Growing, PipeAgain, Whole, WithState, known
from .judging import ALLOWED, at_end, of_set, quiet, traces, worth_another_run
from .lab import Lab, folder_in

PAGE, DISK = 4096, 16 << 20
"""Bytes of a page, and of the small disk."""
EVERY = 40
"""So many calls are tried, however few moments are asked for; so many sizes, however many."""
NEW_NAMESPACE, PRIVATE = 0x00020000, 1 << 18 | 1 << 14
"""Of Linux: flags of unshare and mount."""
Found = tuple[str, int, Counter[str], list[str], float]


class Saved(Episode):
    """Base: a file written from Python, over one that is there already; errors are told as the command tells them."""

    inputs = ()
    outputs = ("saved",)

    def save(self) -> None:
        """Write the file."""
        raise NotImplementedError

    def prepare(self) -> None:
        (self.folder / "saved").write_bytes(b"")  # of which nobody says that it is a user's own

    def work(self) -> int:
        try:
            self.save()
        except OSError as error:
            print(f"thermocorr: error: {error}", file=sys.stderr)
            return 2
        return 0


class SavedModel(Saved):
    name = "save_model"

    def save(self) -> None:
        save_model(self.lab.model, "saved")


class SavedDiagnosis(Saved):
    name = "Diagnosis.save_html"

    def prepare(self) -> None:
        super().prepare()
        self.shown = self.lab.diagnosis

    def save(self) -> None:
        self.shown.save_html("saved")


class SavedRefinement(Saved):
    name = "Refinement.save_html"

    def prepare(self) -> None:
        super().prepare()
        self.shown = self.lab.refinement

    def save(self) -> None:
        self.shown.save_html("saved")


class SavedReport(Saved):
    name = "write_report"

    def save(self) -> None:
        write_report("saved", self.lab.model, *self.lab.fitted)


SAVED = (SavedModel, SavedDiagnosis, SavedRefinement, SavedReport)
FULL: tuple[type[Episode], ...] = (Whole, WithState, Followed, PipeAgain, Growing, Analyze, Export, *SAVED)


def disk_full(kind: type[Episode], lab: Lab, n: int) -> Iterator[Found]:
    """Fill the disk in every way, at most `n` moments each; yields lines of the table."""
    with folder_in(lab.place) as folder:
        counted = kind(lab, folder, random.Random(0)).run(Disturbance(full="once")).calls
    for how in ("once", "on"):
        some = [Disturbance(call=call, full=how) for call in _at_most(counted, max(n, EVERY))]
        yield _tried(f"full, {how}", kind, lab, some)
    contents = [content for content in known(kind, lab)[0].values() if content]
    limits = [max(map(len, contents)) * k // min(n, EVERY) for k in range(min(n, EVERY))]
    yield _tried("largest file", kind, lab, [Disturbance(limit=limit) for limit in limits])
    with small_disk(lab.place) as disk:
        if disk is None or kind is Growing:  # not permitted; a log that could not grow
            return
        small = dataclasses.replace(lab, place=disk)
        pages = 2 * sum(len(content) // PAGE + 2 for content in contents) + 4
        for linkless in (False, True) if len(contents) > 1 else (False,):
            what = "pages, no links" if linkless else "pages left"
            some = [Disturbance(linkless=linkless)] * min(n, EVERY, pages)
            yield _tried(what, kind, small, some, fill(disk, pages, len(some)))


def _at_most(count: int, n: int) -> list[int]:
    """Numbers from 1 to `count`; where these are more than `n`, so many of them, the first and the last included."""
    return sorted({1 + round(k * (count - 1) / max(1, min(n, count) - 1)) for k in range(min(n, count))})


def _tried(
    what: str,
    kind: type[Episode],
    lab: Lab,
    some: list[Disturbance],
    fillers: Iterator[Callable[[], None]] | None = None,
) -> Found:
    found, notes, began = Counter[str](), list[str](), time.monotonic()
    for k, disturbance in enumerate(some):
        with folder_in(lab.place) as folder:
            episode = kind(lab, folder, random.Random(k))
            empty = next(fillers) if fillers is not None else None
            ended = episode.run(disturbance)
            if empty is not None:
                empty()
            faults = _refused(episode, ended)
            runs = [(faults, ended, "")]
            if worth_another_run(episode, episode.rng):
                again = episode.run()
                runs.append((at_end(episode, again), again, "run again after "))
            for wrong, process, when in runs:
                found += wrong
                if {*wrong} - {"late"}:
                    notes.append(f"{when}{what} {disturbance}: {dict(wrong)}, {process.status}, {process.err[-250:]!r}")
    return what, len(some), found, notes, time.monotonic() - began


def _refused(episode: Episode, ended: Ended) -> Counter[str]:
    """What is wrong once a command has met the full disk."""
    faults: Counter[str] = Counter()
    told = ALLOWED.sub("", quiet(episode, ended.err))
    done = ended.status == 0 or (isinstance(episode, Growing) and ended.status == 143)
    one_sentence = told.startswith("thermocorr: error: ") and told.endswith("\n") and told.count("\n") == 1
    faults["late"] += done
    faults["status"] += ended.hangs or not (done or (ended.status == 2 and one_sentence))
    faults["tracebacks"] += traces(ended)
    faults["inputs"] += not episode.intact()
    faults["drafts"] += len(episode.hidden())
    if episode.appends:
        out = episode.files()["out.csv"]
        faults["half"] += bool(out) and not out.endswith(b"\n")
    else:
        faults += of_set(episode, killed=False)
        unchanged = episode.files() == episode.old
        strange = unchanged is done and episode.old != known(type(episode), episode.lab)[0]
        faults["half"] = max(faults["half"], int(strange))
    return +faults


@contextlib.contextmanager
def small_disk(place: Path) -> Iterator[Path | None]:
    """A file system of its own, which this process alone sees; None where that is not permitted."""
    disk, libc = place / "disk", ctypes.CDLL(None, use_errno=True)
    disk.mkdir(exist_ok=True)
    try:
        refused = libc.unshare(NEW_NAMESPACE) or libc.mount(b"none", b"/", None, PRIVATE, None)
        refused = refused or libc.mount(b"tmpfs", os.fsencode(disk), b"tmpfs", 0, f"size={DISK}".encode())
    except AttributeError:  # not Linux
        refused = True
    try:
        yield None if refused else disk
    finally:
        if not refused:
            libc.umount2(os.fsencode(disk), 2)


def fill(disk: Path, most: int, n: int) -> Iterator[Callable[[], None]]:
    """Fill the disk but for some pages, from none to `most`; yields what makes room again."""
    filler = disk / "filler"
    for k in range(n):
        room = shutil.disk_usage(disk).free - k * most // n * PAGE
        with filler.open("wb") as file:
            file.write(bytes(room))
        yield filler.unlink
