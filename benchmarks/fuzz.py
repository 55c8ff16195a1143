"""Spoiled input: does the package refuse it in a sentence, or read it as it stands?

    python benchmarks/fuzz.py --seconds 120 --seed 1
    python benchmarks/fuzz.py --seed 1 --only 4711         # one input again, its files kept

Small logs, model files, saved states and Parquet files are spoiled in one to four ways and given to the commands
`analyze` and `correct` and to the readers below them, in this process. What must come of an input is computed a second
time by Python's own csv, float and datetime, see `fuzzing/oracle.py`. Prints counts of inputs by kind and outcome, and
one line for each input that is silently read wrong, ends in a traceback or in words that are not the package's own,
prints stray lines, takes more than 5 s or more than 500 MB; exits with 1 where there is one. The same seed gives the
same inputs.
"""

import functools
import random
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from common import asked
from fuzzing import json_files, logs, outcomes, parquet_files, subjects

KINDS = {
    "csv correct": (30, logs.correct),
    "csv correct --follow": (8, logs.follow),
    "csv analyze": (8, logs.analyze),
    "csv state in two parts": (4, logs.resume),
    "model file, bytes": (8, json_files.model_bytes),
    "model file, forged": (16, json_files.model_forged),
    "saved state": (12, json_files.state),
    "large file": (0.1, json_files.large),
    "Parquet, both readers": (14, parquet_files.readers),
    "Parquet correct": (8, parquet_files.correct),
}
"""Kinds of inputs, how often each comes, and what makes and judges one."""


def main() -> int:
    options = asked(__doc__, seconds=60.0, inputs=10**9, seed=0, kinds=list(KINDS), only=int)
    counts: Counter[tuple[str, str]] = Counter()
    begin, numbers = time.monotonic(), range(options.inputs) if options.only is None else [options.only]
    with tempfile.TemporaryDirectory() as folder:
        made: dict = subjects.all_subjects(Path(folder))
        made["victims"] = json_files.victims(made, Path(folder))
        for number in numbers:
            if time.monotonic() - begin > options.seconds:
                break
            room = outcomes.Room(Path(tempfile.mkdtemp(prefix="fuzz-")), made)
            rng = random.Random(f"{options.seed}/{number}")  # all of an input follows from this
            kind = rng.choices(options.kinds, [KINDS[kind][0] for kind in options.kinds])[0]
            outcome, words = outcomes.judged(functools.partial(KINDS[kind][1], rng, room))
            counts[kind, outcome] += 1
            if outcome in outcomes.BAD or options.only is not None:
                print(f"{number}: {kind}: {outcome}: {words} ({'; '.join(room.said)[:200]})", flush=True)
            if options.only is None:
                shutil.rmtree(room.folder)
            else:
                print(f"Its files are in {room.folder}")
    print(f"\n{counts.total()} inputs in {time.monotonic() - begin:.0f} s, seed {options.seed}")
    for kind in KINDS:
        told = [f"{counts[kind, outcome]} {outcome}" for outcome in outcomes.ALL if counts[kind, outcome]]
        if told:
            print(f"{kind:>24}: {', '.join(told)}")
    found = sum(counts[kind, outcome] for kind in KINDS for outcome in outcomes.BAD)
    print(f"{found} findings")
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main())
