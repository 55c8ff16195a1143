"""What must be true after a signal and on a full disk, counted where it is not."""

import os
import random
import re
import signal
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd

import thermocorr

from . import episodes
from .children import Disturbance, Ended
from .episodes import Episode, Growing, Lab, folder_in, known

FAULTS = ("lost", "twice", "wrong", "inputs", "half", "drafts", "status", "tracebacks")
"""What is counted: rows that are missing, come more than once, or differ (also in their order); inputs that changed;
files that are neither old nor whole, and sets that are partly new after SIGINT and SIGTERM; drafts that are there after
SIGINT and SIGTERM, or after the next run; processes with another status or message than promised; tracebacks."""
APART = ("late", "system", "mixed")
"""Not wrong: processes that had done it all before the signal; rows that were on their way from the pipe to the file
when SIGKILL came; sets of files of which SIGKILL left some new."""
SELDOM = 0.1  # how often a long command is run again
POWER = 0.3  # how often SIGKILL is a power cut
TOLERANCE = 1e-12  # of a column's range, as an undisturbed run has it
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
                notes.append(f"{disturbance}: {dict(wrong)}, {ended.status}, {ended.err[-250:]!r}")
            has_state = isinstance(episode, episodes.WithState) and not isinstance(episode, episodes.PipeRest)
            if has_state and ended.status == -signal.SIGKILL and rng.random() < POWER:
                episode.lose_power()
        if isinstance(episode, episodes.PipeRest):
            faults["system"] += episode.gone
        if worth_another_run(episode, rng):
            ended = episode.run()
            wrong = at_end(episode, ended)
            faults += wrong
            if wrong:
                told = " ".join(map(str, disturbances))
                notes.append(f"run again after {told}: {dict(wrong)}, {ended.status}, {ended.err[-250:]!r}")
    return faults


def worth_another_run(episode: Episode, rng: random.Random) -> bool:
    """Whether the command is run again to its end: not always where that takes long, and whole files are whole."""
    return not isinstance(episode, episodes.Analyze) or bool(episode.hidden()) or rng.random() < SELDOM


def always(episode: Episode, ended: Ended, well: bool, tidy: bool) -> Counter[str]:
    """What is wrong at any time: how the process ended, a traceback, inputs that changed, drafts that are left."""
    hidden = len(episode.hidden()) if tidy else 0
    status, changed = ended.hangs or not well, not episode.intact()
    return Counter(status=int(status), tracebacks=int(traces(ended)), inputs=int(changed), drafts=hidden)


def torn(episode: Episode) -> bool:
    """Whether the last row of a file to which rows are appended is half a row."""
    out = episode.files()["out.csv"]
    return bool(out) and not out.endswith(b"\n")


def _after_signal(episode: Episode, ended: Ended, disturbance: Disturbance) -> Counter[str]:
    """What is wrong once the signal has ended the process."""
    number = disturbance.signal
    assert number is not None
    killed = number == signal.SIGKILL
    in_time = ended.status == (-9 if killed else 128 + number)
    fine = {0, episode.fine, -number}
    if isinstance(episode, episodes.Fed):  # it has no end of its own: where the disturbance did not come, SIGTERM did
        fine.add(143)
    well = in_time or ended.status in fine
    faults = always(episode, ended, well, tidy=not killed)
    faults["late"] += ended.status in (0, episode.fine)
    if in_time and not killed:
        faults["status"] += not _said_well(episode, ended)
    if episode.appends:
        faults["half"] += torn(episode) and not killed
    else:
        faults += of_set(episode, killed)
    return +faults


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
    fine = {143} if isinstance(episode, Growing) else {0, episode.fine}  # the damaged rows may have come before
    faults = always(episode, ended, ended.status in fine, tidy=True)
    if not isinstance(episode, Growing):
        faults["status"] += bool(ALLOWED.sub("", quiet(episode, ended.err)))
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
    (head, *rows), (true_head, *true_rows) = (
        [line.rsplit(",", n_results) for line in text.decode().splitlines() or [""]] for text in (got, wanted)
    )
    keys, true_keys = [row[0] for row in rows], [row[0] for row in true_rows]
    answers, counts = dict(zip(keys, rows, strict=True)), Counter(keys)
    found = pd.DataFrame([answers[key][1:] for key in true_keys if key in answers])
    true = pd.DataFrame([row[1:] for row in true_rows if row[0] in answers])
    differ = np.zeros(len(true), bool)
    for name in true:
        one, other = found[name], true[name]
        values, exact = (pd.to_numeric(column.replace("", "nan"), errors="coerce") for column in (one, other))
        if exact.notna().any():  # numbers: within the tolerance
            differ |= ~np.isclose(values, exact, rtol=0, atol=TOLERANCE * (exact.max() - exact.min()), equal_nan=True)
        else:
            differ |= (one != other).to_numpy()
    strangers = len({*keys} - {*true_keys})
    moved = [*counts] != [key for key in true_keys if key in counts]
    return +Counter(
        half=int(not got.endswith(b"\n")),
        lost=len({*true_keys} - {*keys}),
        twice=sum(counts.values()) - len(counts),
        wrong=int(head != true_head) + strangers + int(moved) + int(differ.sum()),
    )


EVERY = 40  # so many calls are tried, however few moments are asked for; so many sizes, however many
Found = tuple[str, int, Counter[str], list[str]]


def disk_full(kind: type[Episode], lab: Lab, n: int) -> Iterator[Found]:
    """Fill the disk in every way, at most `n` moments each; yields lines of the table."""
    with folder_in(lab.place) as folder:
        counted = kind(lab, folder, random.Random(0)).run(Disturbance(full="once")).calls
    for how in ("once", "on"):
        some = [Disturbance(call=call, full=how) for call in _at_most(counted, max(n, EVERY))]
        yield _tried(f"full, {how}", kind, lab, some)
    longest = max(len(content) for content in known(kind, lab)[0].values() if content)
    limits = [longest * k // min(n, EVERY) for k in range(min(n, EVERY))]
    yield _tried("largest file", kind, lab, [Disturbance(limit=limit) for limit in limits])


def _at_most(count: int, n: int) -> list[int]:
    """Numbers from 1 to `count`; where these are more than `n`, so many of them, the first and the last included."""
    return sorted({1 + round(k * (count - 1) / max(1, min(n, count) - 1)) for k in range(min(n, count))})


def _tried(what: str, kind: type[Episode], lab: Lab, some: list[Disturbance]) -> Found:
    found, notes = Counter[str](), list[str]()
    for k, disturbance in enumerate(some):
        with folder_in(lab.place) as folder:
            episode = kind(lab, folder, random.Random(k))
            ended = episode.run(disturbance)
            runs = [("", ended, _refused(episode, ended))]
            if worth_another_run(episode, episode.rng):
                again = episode.run()
                runs.append(("run again after ", again, at_end(episode, again)))
            for when, process, wrong in runs:
                found += wrong
                if {*wrong} - {"late"}:
                    notes.append(f"{when}{what} {disturbance}: {dict(wrong)}, {process.status}, {process.err[-250:]!r}")
    return what, len(some), found, notes


def _refused(episode: Episode, ended: Ended) -> Counter[str]:
    """What is wrong once a command has met the full disk."""
    told = ALLOWED.sub("", quiet(episode, ended.err))
    done = ended.status == 0 or (isinstance(episode, Growing) and ended.status == 143)
    one_sentence = told.startswith("thermocorr: error: ") and told.endswith("\n") and told.count("\n") == 1
    faults = always(episode, ended, done or (ended.status == 2 and one_sentence), True)
    faults["late"] += done
    if episode.appends:
        faults["half"] += torn(episode)
    else:
        faults += of_set(episode, killed=False)
        unchanged = episode.files() == episode.old
        strange = unchanged is done and episode.old != known(type(episode), episode.lab)[0]
        faults["half"] = max(faults["half"], int(strange))
    return +faults
