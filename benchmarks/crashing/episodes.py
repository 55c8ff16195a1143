"""Episodes: a command begins in a folder, is disturbed, and is run again to its end; and what all of them work on."""

import contextlib
import gc
import json
import os
import random
import stat
import tempfile
import warnings
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from thermocorr import DynamicBiasRegressor, RecordWarning, save_model
from thermocorr.command.cli import main
from thermocorr.datasets import make_record

from .children import Child, Disturbance, Ended, Feed

FITTED, ROWS, LONG = 500, 250, 1000
"""Rows that the model is fitted to; of a log that is fed piece by piece; of one that is there from the start."""


@dataclass
class Lab:
    """What all moments share."""

    place: Path  # folder to work in
    model_file: bytes
    record: bytes  # a log to analyse
    log: bytes  # a short log to correct
    damaged: bytes  # the same with dates in the future and in the past
    long: bytes  # a long log to correct, with dates in the future
    known: dict[Any, Any]  # what undisturbed runs gave, by kind of run


def make_lab(place: Path) -> Lab:
    """Fit the model and write the logs."""
    record = _record()
    fitted = record[:FITTED].drop(columns="note")
    X, y = fitted.drop(columns="reading"), fitted["reading"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordWarning)
        model = DynamicBiasRegressor(time="time", time_constants=[600.0, 7200.0], max_gap="1h").fit(X, y)
    save_model(model, place / "model.json")
    gc.freeze()  # children share what is there
    log = record[FITTED:]
    late = _dated(log, "2124", 15)
    parts = (fitted, log[:ROWS], _dated(late, "1924", 5)[:ROWS], late)
    texts = [part.to_csv(index=False).encode() for part in parts]
    return Lab(place, (place / "model.json").read_bytes(), *texts, {})


def _record() -> pd.DataFrame:
    """With a gap, empty cells and a column of text, behind what the model is fitted to."""
    record = make_record(FITTED + LONG, seed=5).reset_index()
    record.loc[FITTED + 100 :, "time"] += pd.Timedelta("2h")
    record["time"] = record["time"].dt.strftime("%Y-%m-%dT%H:%M:%S")
    record["note"] = ["as usual", 'the "door", open'] * (len(record) // 2)
    for column, row in (("reading", 40), ("temperature", 160), ("reading", 500), ("temperature", 750)):
        record.loc[FITTED + row, column] = float("nan")
    return record


def _dated(log: pd.DataFrame, year: str, first: int) -> pd.DataFrame:
    """With every twentieth date damaged."""
    times = log["time"].copy()
    times[first::20] = year + times[first::20].str[4:]
    return log.assign(time=times)


@contextlib.contextmanager
def folder_in(place: Path) -> Iterator[Path]:
    """An empty folder, for a while."""
    with tempfile.TemporaryDirectory(dir=place) as name:
        yield Path(name)


def look(path: Path) -> tuple[Any, ...]:
    """What a command must not change in a file that it reads."""
    seen = os.stat(path)
    return path.read_bytes(), seen.st_mtime_ns, seen.st_mode, seen.st_ino


MODEL = ("--model", "model.json")
STATE = ("--out", "out.csv", "--state", "state.json", "--average", "7", "--track", "2h")


class Episode:
    """Base: a command that writes whole files, all of its `outputs` or none, in a folder that is empty before."""

    name = ""
    arguments: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ("log.csv", "model.json")
    outputs: tuple[str, ...] = ("out.csv",)
    fine = 0  # status of a run that nothing disturbs: 1 for a log with damaged rows
    appends = False  # whether rows are appended to out.csv; else outputs are old or new
    chatter: tuple[str, ...] = ()  # beginnings of lines on standard error that are no complaints

    def __init__(self, lab: Lab, folder: Path, rng: random.Random):
        self.lab, self.folder, self.rng = lab, folder, rng
        self.given = {"log.csv": lab.long, "model.json": lab.model_file, "record.csv": lab.record}
        for name in self.inputs:
            (folder / name).write_bytes(self.given[name])
        self.prepare()
        self.before = {name: look(folder / name) for name in self.inputs}
        self.old = self.files()

    def prepare(self) -> None:
        """Put there what an earlier run left."""

    def work(self) -> int:
        """What the process does."""
        return main([*self.arguments])

    def run(self, disturbance: Disturbance | None = None) -> Ended:
        """Run the command from what is there now until it ends, or is ended."""
        return Child(self.work, self.folder, disturbance=disturbance).attend()

    def files(self) -> dict[str, bytes | None]:
        """The outputs as they are; None for those that are not there."""
        found = {name: self.folder / name for name in self.outputs}
        return {name: path.read_bytes() if path.exists() else None for name, path in found.items()}

    def hidden(self) -> list[str]:
        """Files that are neither inputs nor results."""
        return [path.name for path in self.folder.rglob("*") if path.name.startswith(".") or "draft" in path.name]

    def intact(self) -> bool:
        """Whether the inputs are what they were."""
        return all(look(self.folder / name) == seen for name, seen in self.before.items())

    def expected(self) -> dict[str, bytes | None]:
        """The outputs at the end of it all."""
        return known(type(self), self.lab)[0]

    def rows_on_disk(self) -> int:
        """Rows in out.csv, less its header."""
        path = self.folder / "out.csv"
        return max(0, path.read_bytes().count(b"\n") - 1) if path.exists() else 0


def known(kind: type[Episode], lab: Lab) -> tuple[dict[str, bytes | None], Ended]:
    """Outputs of undisturbed runs of this kind, and how one of three usually went; kept in the lab."""
    if kind not in lab.known:
        found = []
        for _ in range(3):
            with folder_in(lab.place) as folder:
                episode = kind(lab, folder, random.Random(0))
                ended = episode.run()
                assert ended.status in (kind.fine, 143) and "Traceback" not in ended.err, f"{kind.name}: {ended}"
                found.append((episode.files(), ended))
        if not kind.appends:
            assert all(files == found[0][0] for files, _ in found), f"{kind.name}: runs differ"
        lab.known[kind] = sorted(found, key=lambda run: run[1].seconds)[1]
    return lab.known[kind]  # type: ignore[no-any-return]


def earlier(lab: Lab, folder: Path, arguments: tuple[str, ...], outputs: tuple[str, ...]) -> None:
    """Put there what the same command gave with other arguments; run once, then kept in the lab."""
    if arguments not in lab.known:
        assert Child(lambda: main([*arguments]), folder).attend().status == 0
        lab.known[arguments] = {name: (folder / name).read_bytes() for name in outputs}
    for name, content in lab.known[arguments].items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)


class Whole(Episode):
    """A log that is there, into a file that appears at the end; every other time an older one is there."""

    name = "file -> --out"
    arguments = ("correct", *MODEL, "log.csv", "--out", "out.csv")

    def prepare(self) -> None:
        if self.rng.random() < 0.5:
            earlier(self.lab, self.folder, (*self.arguments, "--average", "3"), self.outputs)


class WithState(Episode):
    """A log that is there, row by row into a file that the next run takes up."""

    name = "file -> --out --state"
    arguments = ("correct", *MODEL, "log.csv", *STATE)
    appends = True

    def lose_power(self) -> None:
        """Of the rows since the last saving, which were not brought to the disk, some are gone, and one is torn.

        The header was: the file appears with it.
        """
        out, state = self.folder / "out.csv", self.folder / "state.json"
        if out.exists():
            header = out.read_bytes().index(b"\n") + 1
            safe = json.loads(state.read_bytes())["out"]["length"] if state.exists() else header
            os.truncate(out, self.rng.randint(safe, out.stat().st_size))


class Fed(WithState):
    """Base: a log that comes in pieces of whole and half lines."""

    pause = 0.0015  # between two pieces [s]

    def __init__(self, lab: Lab, folder: Path, rng: random.Random):
        super().__init__(lab, folder, rng)
        self.log = lab.damaged if self.fine else lab.log
        self.header = self.log[: self.log.index(b"\n") + 1]

    def pieces(self, content: bytes) -> deque[bytes]:
        """Cut at random, also within lines."""
        cuts = sorted(self.rng.sample(range(1, len(content)), min(40, len(content) - 1)))
        return deque(content[low:high] for low, high in zip([0, *cuts], [*cuts, len(content)], strict=True))


class PipeAgain(Fed):
    """A pipe that is fed from the start again, as `cat log | thermocorr correct - ...` would."""

    name = "pipe, fed from the start again"
    arguments = ("correct", *MODEL, "-", *STATE, "--follow")
    inputs = ("model.json",)

    def run(self, disturbance: Disturbance | None = None) -> Ended:
        return self.fed(self.log, disturbance)[0]

    def fed(self, content: bytes, disturbance: Disturbance | None) -> tuple[Ended, bytes]:
        """Run with this content on standard input; returns also what the process has left unread of it."""
        stdin, end = os.pipe()
        feed = Feed(self.pieces(content), lambda piece: os.write(end, piece), self.pause, lambda: os.close(end))
        ended = Child(self.work, self.folder, stdin, disturbance, close=(end,)).attend(feed)
        if feed.finish is not None:
            os.close(end)
        left = b"".join(iter(lambda: os.read(stdin, 1 << 16), b"")) + b"".join(feed.pieces)
        os.close(stdin)
        return ended, left


class PipeRest(PipeAgain):
    """A pipe whose unread rest the next process gets, behind the header."""

    name = "pipe, fed with the rest"

    def __init__(self, lab: Lab, folder: Path, rng: random.Random):
        super().__init__(lab, folder, rng)
        self.rest = self.log
        self.gone = 0  # rows that were read from the pipe, and not written when SIGKILL came
        self.kept: list[bytes] = self.log.splitlines(keepends=True)[1:]  # rows that are to come out

    def run(self, disturbance: Disturbance | None = None) -> Ended:
        given = self.rest
        ended, left = self.fed(given, disturbance)
        taken = given[: len(given) - len(left)]
        if disturbance is not None:
            if ended.status == -9 and len(taken) > len(self.header):
                if not taken.endswith(b"\n"):  # the rest of a line that was being read is no row
                    taken = given[: given.index(b"\n", len(taken)) + 1]
                done, read = self.rows_on_disk(), taken.count(b"\n") - 1
                self.gone, self.kept = read - done, [*self.kept[:done], *self.kept[read:]]
            self.rest = self.header + given[max(len(taken), len(self.header)) :]
        return ended

    def expected(self) -> dict[str, bytes | None]:
        if not self.gone:
            return super().expected()
        with folder_in(self.folder.parent) as other:
            (other / "log.csv").write_bytes(b"".join([self.header, *self.kept]))
            (other / "model.json").write_bytes(self.lab.model_file)
            ended = Child(lambda: main([*WithState.arguments]), other).attend()
            assert ended.status in (0, self.fine), ended  # the damaged rows may be among those that are gone
            return {"out.csv": (other / "out.csv").read_bytes()}


class PipeAgainDamaged(PipeAgain):
    """The same where the log has dates in the future and in the past."""

    name = "the same, damaged dates"
    fine = 1


class PipeRestDamaged(PipeRest):
    """The same where the log has dates in the future and in the past."""

    name = "the rest, damaged dates"
    fine = 1


class Growing(Fed):
    """A file that grows, also between two runs; the last one is ended when all rows are there."""

    name = "growing file, --follow"
    arguments = ("correct", *MODEL, "log.csv", *STATE, "--follow")

    def __init__(self, lab: Lab, folder: Path, rng: random.Random):
        super().__init__(lab, folder, rng)
        (folder / "log.csv").write_bytes(b"")
        self.to_come = self.pieces(self.log)
        self.fresh = True

    def grow(self, piece: bytes) -> None:
        """The instrument writes."""
        with (self.folder / "log.csv").open("ab") as file:
            file.write(piece)

    def run(self, disturbance: Disturbance | None = None) -> Ended:
        if not self.fresh:
            for _ in range(len(self.to_come) // 2):
                self.grow(self.to_come.popleft())
        self.fresh = False
        begun_with = self.state_file()

        def complete() -> bool:
            """The process is at work, and has done all."""
            return self.state_file() != begun_with and self.rows_on_disk() >= self.log.count(b"\n") - 1

        feed = Feed(self.to_come, self.grow, self.pause, complete=complete)
        return Child(self.work, self.folder, disturbance=disturbance).attend(feed)

    def state_file(self) -> int:
        """What tells a state that was saved from the one before."""
        path = self.folder / "state.json"
        return path.stat().st_ino if path.exists() else 0

    def intact(self) -> bool:
        path = self.folder / "log.csv"
        content, _, mode, number = look(path)
        handed_over = self.log[: len(self.log) - sum(map(len, self.to_come))]
        same_file = (mode, number) == self.before["log.csv"][2:] and stat.S_ISREG(mode)
        return content == handed_over and same_file and look(self.folder / "model.json") == self.before["model.json"]


class Analyze(Episode):
    """`thermocorr analyze` into the folder of an earlier run."""

    name = "analyze --out --report"
    arguments = ("analyze", "record.csv", "--reading", "reading", "--time-constants", "10min,2h", "--blocks", "2",
                 "--quiet", "--out", "results", "--report")  # fmt: skip
    inputs = ("record.csv",)
    outputs = tuple(f"results/{name}" for name in ("corrected.csv", "model.json", "model.txt", "report.html"))

    def prepare(self) -> None:
        earlier(self.lab, self.folder, (*self.arguments, "--degree", "1"), self.outputs)


class Export(Episode):
    """`thermocorr export-c` into the folder of an earlier run."""

    name = "export-c --out"
    arguments = ("export-c", *MODEL, "--out", "firmware")
    inputs = ("model.json",)
    outputs = tuple(f"firmware/thermal_bias{ending}" for ending in (".h", ".c", "_test.c"))
    chatter = ("Loading ",)

    def prepare(self) -> None:
        earlier(self.lab, self.folder, (*self.arguments, "--double"), self.outputs)


KINDS = (Whole, WithState, PipeRest, PipeRestDamaged, PipeAgain, PipeAgainDamaged, Growing, Analyze, Export)
FULL = (Whole, WithState, PipeAgain, Growing, Analyze, Export)  # what meets a full disk
