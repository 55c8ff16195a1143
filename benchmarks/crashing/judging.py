"""What must be true after an episode, counted where it is not."""

from __future__ import annotations

import os
import random
import re
import signal
from collections import Counter
from collections.abc import Sequence

import numpy as np

import thermocorr

from .calls import Disturbance
from .children import Ended
from .episodes import Analyze, Episode, Fed, Growing, PipeRest, WithState, known
from .lab import Lab, folder_in

FAULTS = ("lost", "twice", "wrong", "inputs", "half", "drafts", "status", "tracebacks")
"""What is counted: rows that are missing, come more than once, or differ (also in their order); inputs that changed;
files that are neither old nor whole, and sets that are partly new after SIGINT and SIGTERM; drafts that are there after
SIGINT and SIGTERM, or after the next run; processes with another status or message than promised; tracebacks."""
APART = ("late", "system", "mixed")
"""Not wrong: processes that had done it all before the signal; rows that were on their way from the pipe to the file
when SIGKILL came; sets of files of which SIGKILL left some new."""
SELDOM = 0.1
"""How often a long command is run again."""
POWER = 0.3
"""How often SIGKILL is a power cut."""
TOLERANCE = 1e-12
"""Of a column's range, as an undisturbed run has it."""
PACKAGE = os.path.dirname(thermocorr.__file__)
STOPPED = re.compile(r"thermocorr: stopped( after row (\d+), \S.*| before the first line; nothing was written)?\n")
ALLOWED = re.compile(
    r"thermocorr: (\d+ (line was|lines were) corrected before, by the saved state"
    r"|\d+ of \d+ lines? got no result: \d+ (no|backward) .*|\d+ of \d+ lines are flagged.*)\n"
)


def disturbed(
    kind: type[Episode], lab: Lab, rng: random.Random, disturbances: Sequence[Disturbance], notes: list[str]
) -> Counter[str]:
    """One episode: disturbed once or more, then run to its end. Returns what was wrong; notes say it in words."""
    faults: Counter[str] = Counter()
    with folder_in(lab.place) as folder:
        episode = kind(lab, folder, rng)
        for disturbance in disturbances:
            ended = episode.run(disturbance)
            wrong = _after_signal(episode, ended, disturbance)
            faults += wrong
            if {*wrong} & {*FAULTS}:
                notes.append(f"{_named(disturbance)} at {disturbance}: {dict(wrong)}, {_shown(ended)}")
            if (
                ended.status == -signal.SIGKILL
                and isinstance(episode, WithState)
                and not isinstance(episode, PipeRest)
                and rng.random() < POWER
            ):
                episode.lose_power()
        if isinstance(episode, PipeRest):
            faults["system"] += episode.gone
        if worth_another_run(episode, rng):
            ended = episode.run()
            wrong = at_end(episode, ended)
            faults += wrong
            if wrong:
                told = " ".join(f"{_named(one)} at {one}" for one in disturbances)
                notes.append(f"run again after {told}: {dict(wrong)}, {_shown(ended)}")
    return faults


def worth_another_run(episode: Episode, rng: random.Random) -> bool:
    """Whether the command is run again to its end: not always where that takes long, and whole files are whole."""
    return not isinstance(episode, Analyze) or bool(episode.hidden()) or rng.random() < SELDOM


def _named(disturbance: Disturbance) -> str:
    return signal.Signals(disturbance.signal or 0).name


def _shown(ended: Ended) -> str:
    return f"status {ended.status}, said {ended.err[-250:]!r}"


def _after_signal(episode: Episode, ended: Ended, disturbance: Disturbance) -> Counter[str]:
    """What is wrong once the signal has ended the process."""
    faults: Counter[str] = Counter()
    number = disturbance.signal
    assert number is not None
    in_time = ended.status == (-9 if number == signal.SIGKILL else 128 + number)
    faults["late"] += ended.status in (0, episode.fine)
    faults["tracebacks"] += traces(ended)
    faults["inputs"] += not episode.intact()
    faults["status"] += ended.hangs or not (
        in_time or ended.status in (0, episode.fine, -number) or _told_to_end(episode, ended)
    )
    if in_time and number != signal.SIGKILL:
        faults["status"] += not _said_well(episode, ended)
    if number != signal.SIGKILL:
        faults["drafts"] += len(episode.hidden())
    if episode.appends:
        out = episode.files()["out.csv"]
        faults["half"] += bool(out) and not out.endswith(b"\n") and number != signal.SIGKILL
    else:
        faults += of_set(episode, number == signal.SIGKILL)
    return +faults


def _told_to_end(episode: Episode, ended: Ended) -> bool:
    """A followed file has no end of its own: where the disturbance did not come, SIGTERM did."""
    return isinstance(episode, Fed) and ended.status == 143


def _said_well(episode: Episode, ended: Ended) -> bool:
    """Whether one line says where it stopped, and the rows are there."""
    said = STOPPED.fullmatch(ALLOWED.sub("", quiet(episode, ended.err)))
    if said is None:
        return False
    return not (episode.appends and said[2]) or int(said[2]) == episode.rows_on_disk()


def of_set(episode: Episode, killed: bool) -> Counter[str]:
    """Files that are neither old nor new, and sets that are both."""
    new, faults, found = known(type(episode), episode.lab)[0], Counter[str](), set()
    for name, content in episode.files().items():
        is_old, is_new = content == episode.old[name], content == new[name]
        faults["half"] += not (is_old or is_new)
        if is_old != is_new:
            found.add(is_new)
    if len(found) > 1:
        faults["mixed" if killed else "half"] += 1
    return +faults


def at_end(episode: Episode, ended: Ended) -> Counter[str]:
    """What is wrong when the command has been run again, to its end."""
    faults: Counter[str] = Counter()
    fine = {143} if isinstance(episode, Growing) else {0, episode.fine}  # the damaged rows may have come before
    faults["status"] += ended.status not in fine or ended.hangs
    if not isinstance(episode, Growing):
        faults["status"] += bool(ALLOWED.sub("", quiet(episode, ended.err)))
    faults["tracebacks"] += traces(ended)
    faults["inputs"] += not episode.intact()
    faults["drafts"] += len(episode.hidden())
    wanted = episode.expected()
    for name, content in episode.files().items():
        if not episode.appends:
            faults["half"] += content != wanted[name]
        elif content != wanted[name]:
            faults += compared(content or b"", wanted[name] or b"")
    return +faults


def quiet(episode: Episode, said: str) -> str:
    """Standard error less what only says what is being done."""
    return "".join(line for line in said.splitlines(keepends=True) if not line.startswith(episode.chatter or "\0"))


def traces(ended: Ended) -> bool:
    """Whether the interpreter spoke instead of the command; before that is loaded, there is nobody else."""
    spoke = "Traceback" in ended.err or "Exception ignored" in ended.err
    began = re.search(rf"{re.escape(PACKAGE)}/(?!__init__\.py|_version\.py)", ended.err)
    return spoke and (began is not None or ended.status != -signal.SIGINT)


def compared(got: bytes, wanted: bytes, n_results: int = 5) -> Counter[str]:
    """Rows of two corrected logs: lost, twice, wrong; a torn end counts as half a file."""
    faults: Counter[str] = Counter()
    faults["half"] += not got.endswith(b"\n")
    (head, *rows), (true_head, *true_rows) = (
        [line.rsplit(",", n_results) for line in text.decode().splitlines() or [""]] for text in (got, wanted)
    )
    keys, true_keys = [row[0] for row in rows], [row[0] for row in true_rows]
    counts = Counter(keys)
    faults["lost"] += len({*true_keys} - {*keys})
    faults["twice"] += sum(count - 1 for count in counts.values())
    faults["wrong"] += head != true_head
    faults["wrong"] += len({*keys} - {*true_keys})
    if [*counts] != [key for key in true_keys if key in counts]:
        faults["wrong"] += 1
    answers = dict(zip(keys, rows, strict=True))
    pairs = [(answers[row[0]], row) for row in true_rows if row[0] in answers]
    if pairs:
        faults["wrong"] += _differing(*zip(*pairs, strict=True))
    return +faults


def _differing(got: tuple[list[str], ...], wanted: tuple[list[str], ...]) -> int:
    """Rows whose results differ: numbers by more than the tolerance, text at all."""
    if {len(row) for row in (*got, *wanted)} != {len(wanted[0])}:
        return len(wanted)
    differ = np.zeros(len(wanted), bool)
    for k in range(1, len(wanted[0])):
        one, other = [row[k] for row in got], [row[k] for row in wanted]
        try:
            values, true = (np.array([cell or "nan" for cell in column], float) for column in (one, other))
        except ValueError:
            differ |= np.array(one) != np.array(other)
            continue
        if np.isnan(true).all():
            differ |= ~np.isnan(values)
            continue
        apart = np.abs(values - true) > TOLERANCE * (np.nanmax(true) - np.nanmin(true))
        differ |= apart | (np.isnan(values) != np.isnan(true))
    return int(differ.sum())
