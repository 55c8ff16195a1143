"""Spoiled input: does the package refuse it in a sentence, or read it as it stands?

    python benchmarks/fuzz.py --seconds 120 --seed 1
    python benchmarks/fuzz.py --seed 1 --only 4711         # one input again, its files kept

Small logs, model files, saved states and Parquet files are spoiled in one to four ways and given to the commands
`analyze` and `correct` and to the readers below them, in this process; what takes much memory runs in a process of its
own. What must come of an input is computed a second time by Python's own csv, float and datetime, see
`fuzzing/oracle.py`. Prints counts of inputs by kind and outcome, and one line for each input that is silently read
wrong, ends in a traceback or in words that are not the package's own, prints stray lines, takes more than 5 s or more
than 500 MB; exits with 1 where there is one. The same seed gives the same inputs.
"""

from __future__ import annotations

import argparse
import random
import re
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from fuzzing import children, json_files, logs, outcomes, parquet_files, subjects


class Kind(NamedTuple):
    """One kind of input."""

    weight: float
    run: object
    seconds: float = outcomes.SECONDS
    """Limit of its time [s]."""


KINDS = {
    "csv correct": Kind(30, logs.correct),
    "csv correct --follow": Kind(8, logs.follow),
    "csv read_table": Kind(25, logs.read),
    "csv analyze": Kind(2, logs.analyze),
    "csv state in two parts": Kind(4, logs.resume),
    "model file, bytes": Kind(8, json_files.model_bytes),
    "model file, forged": Kind(16, json_files.model_forged),
    "saved state": Kind(12, json_files.state),
    "Parquet, both readers": Kind(14, parquet_files.readers),
    "Parquet correct": Kind(8, parquet_files.correct),
    "Parquet analyze": Kind(1, parquet_files.analyze),
    "large file": Kind(0.05, children.memory, 120.0),
}


def one(seed: int, number: int, room: outcomes.Room, only: str | None = None) -> tuple[str, str, str]:
    """Kind, outcome and words of an input: all of it follows from the seed and its number."""
    rng = random.Random(f"{seed}/{number}")
    names = [only] if only else list(KINDS)
    name = rng.choices(names, [KINDS[n].weight for n in names])[0]
    kind = KINDS[name]
    outcome, words = outcomes.judged(lambda: kind.run(rng, room), kind.seconds)
    return name, outcome, words


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="how long (default 60)")
    parser.add_argument("--inputs", type=int, default=10**9, metavar="M", help="at most so many inputs")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", choices=list(KINDS), help="inputs of one kind only")
    parser.add_argument("--only", type=int, metavar="CASE", help="one input again, by its number")
    parser.add_argument("--alike", type=int, default=2, metavar="N", help="findings of the same words to print")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        made: dict = subjects.all_subjects(Path(folder))
        made["victims"] = json_files.victims(made, Path(folder))
        if options.only is not None:
            return show(options, made)
        return loop(options, made, Path(folder))


def loop(options: argparse.Namespace, made: dict, folder: Path) -> int:
    counts: Counter[tuple[str, str]] = Counter()
    seen: Counter[tuple[str, str, str]] = Counter()
    begin, number, found = time.monotonic(), 0, 0
    while number < options.inputs and time.monotonic() - begin < options.seconds:
        with tempfile.TemporaryDirectory(dir=folder) as own:
            room = outcomes.Room(Path(own), made)
            name, outcome, words = one(options.seed, number, room, options.kind)
        counts[name, outcome] += 1
        if outcome in outcomes.BAD:
            found += 1
            alike = re.sub(r"/\S+|\d+|'[^']*'|line \S+|\[.*", "", words)
            seen[name, outcome, alike] += 1
            if seen[name, outcome, alike] > options.alike:
                number += 1
                continue
            again = f"--seed {options.seed}" + (f" --kind '{options.kind}'" if options.kind else "")
            about = "; ".join(room.said)[:200]
            print(f"{name}: {outcome}: {words} ({about}) [{again} --only {number}]", flush=True)
        number += 1
    seconds = time.monotonic() - begin
    print(f"\n{number} inputs in {seconds:.0f} s, {number / seconds:.0f} a second, seed {options.seed}")
    for name in KINDS:
        told = [f"{counts[name, kind]} {kind}" for kind in (*outcomes.GOOD, *outcomes.BAD) if counts[name, kind]]
        if told:
            print(f"{name:>24}: {sum(counts[name, k] for k in (*outcomes.GOOD, *outcomes.BAD)):6}  {', '.join(told)}")
    print(f"{found} findings")
    return 1 if found else 0


def show(options: argparse.Namespace, made: dict) -> int:
    """One input again, with what it was."""
    room = outcomes.Room(Path(tempfile.mkdtemp(prefix="fuzz-")), made)
    name, outcome, words = one(options.seed, options.only, room, options.kind)
    print(f"{name}: {'; '.join(room.said)}\n{outcome}: {words}\nIts files are in {room.folder}")
    return 1 if outcome in outcomes.BAD else 0


if __name__ == "__main__":
    sys.exit(main())
