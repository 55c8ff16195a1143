"""Power cuts, interrupts and full disks: does a command ever lose a row, harm a file, or leave something behind?

    python benchmarks/crash.py                       # 300 moments for each way of running and each signal
    python benchmarks/crash.py --moments 40 --only pipe     # lines whose name holds this
    python benchmarks/crash.py --moments 6 --calls          # signals at calls only, not at random times

SIGTERM, SIGINT and SIGKILL come at random moments (a third in the start, the middle and the end each, as an undisturbed
run has them) and at calls that open, write, rename or remove a file: before it, after it, or with half of the bytes
written. SIGKILL is a power cut at times, which takes rows that were not brought to the disk. Then the command is run
again to its end, and its results are compared with those of an undisturbed run.

Then the disk is full: at each such call once, from it on, and for files above a given size. The command must end with
status 2 and one sentence, leave what was there, and do its work when it is run again.

A new process spends most of its time with imports (tests/test_interrupts.py looks at these). Here one process imports
the package and forks a child for each moment, which takes the signal handlers of a new process and calls
`thermocorr.command.cli.main`; constants of the package are made small, so that the state is saved every 10 ms.

Prints what was found, one line for each way of running and each signal, and ends with status 1 if anything is wrong.
The same seed makes the same choices; what a process does at a time is for the system to say.
"""

import argparse
import os
import random
import signal
import sys
import tempfile
from collections import Counter
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is imported: a process with threads must not fork

from common import asked
from crashing.children import Disturbance
from crashing.episodes import FULL, KINDS, Episode, Lab, PipeRest, known, make_lab
from crashing.judging import APART, FAULTS, disk_full, disturbed

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGKILL)
AGAIN = 0.25  # how often a process that goes on is ended too
MEMORY = Path("/dev/shm")  # a file system that no disk slows down
NAMED = 4  # findings in words, for each line of the table


def moments(
    kind: type[Episode], lab: Lab, rng: random.Random, number: int, n: int, calls_only: bool
) -> list[list[Disturbance]]:
    """When the signal comes: two thirds of them at random times, the others at calls."""
    usual = known(kind, lab)[1]
    calls = range(1, usual.calls + 1)
    at_calls = rng.sample(calls, min(len(calls), n if calls_only else n // 3))
    n = len(at_calls) if calls_only else n
    chosen = [Disturbance(number, None, call, rng.choice(["before", "half", "after"])) for call in at_calls]
    chosen += [Disturbance(number, _time(rng, usual.seconds, k)) for k in range(n - len(chosen))]
    again = kind.appends and not issubclass(kind, PipeRest)
    twice = [[Disturbance(number, _time(rng, usual.seconds, k))] * (again and rng.random() < AGAIN) for k in range(n)]
    return [[one, *more] for one, more in zip(chosen, twice, strict=True)]


def _time(rng: random.Random, seconds: float, k: int) -> float:
    """A moment in the start, the middle or the end of a run [s]."""
    return seconds * rng.uniform(*[(0.0, 0.2), (0.2, 0.8), (0.8, 1.05)][k % 3])


def main() -> int:
    options = asked(__doc__, moments=300, seed=0, only=[""], calls=False)
    wrong = 0
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as work:
        lab = make_lab(Path(work))
        print(f"{'command':30} {'ended by':16}{'moments':>8}" + "".join(f"{head:>11}" for head in (*FAULTS, *APART)))
        for kind in KINDS:
            for number in SIGNALS:
                if any(name in f"{kind.name}, {number.name}" for name in options.only):
                    wrong += _ended_by(kind, lab, number, options)
        for kind in FULL:
            if any(name in f"{kind.name}, disk full" for name in options.only):
                wrong += sum(_shown(kind.name, *found) for found in disk_full(kind, lab, options.moments))
    print(f"{wrong} findings" if wrong else "nothing is wrong")
    return 1 if wrong else 0


def _ended_by(kind: type[Episode], lab: Lab, number: signal.Signals, options: argparse.Namespace) -> int:
    rng = random.Random(f"{options.seed} {kind.name} {number}")
    found, notes = Counter[str](), list[str]()
    chosen = moments(kind, lab, rng, number, options.moments, options.calls)
    for disturbances in chosen:
        found += disturbed(kind, lab, rng, disturbances, notes)
    return _shown(kind.name, number.name, len(chosen), found, notes)


def _shown(name: str, what: str, n: int, found: Counter[str], notes: list[str]) -> int:
    """Print a line of the table, and findings in words; the number of faults."""
    print(f"{name:30} {what:16}{n:8}" + "".join(f"{found[key]:11}" for key in (*FAULTS, *APART)), flush=True)
    for note in notes[:NAMED]:
        print(f"    {note}", flush=True)
    return sum(found[key] for key in FAULTS)


if __name__ == "__main__":
    sys.exit(main())
