"""What the package is worth, in one table: what it finds, whom it accuses wrongly, and which promises it keeps.

    python benchmarks/value.py --quick                # at most 5 minutes of processor time
    python benchmarks/value.py                        # at most an hour
    python benchmarks/value.py --first 31000          # fresh seeds, instead of those of the stored baseline
    python benchmarks/value.py --parts hidden nothing --verbose
    python benchmarks/value.py --parts hidden nothing --level LEVEL=0.02      # a threshold of `judgement/levels.py`

Every question is asked of n records and answered by yes or no: the table shows k of n with the 95 % interval of
Clopper and Pearson, and what benchmarks/value.json has stored of an earlier state (`--write` stores). Records that both
have in common are compared in pairs, by the exact sign test; other seeds by Fisher's exact test. A question is *worse*
where that test rejects at 2.5 %; the exit status is 1 then. Figures (errors as ratios, in dB) are compared in pairs by
the t test. The stored seeds serve no choice: tune on others. Measured records are read from `--records`; where the
folder is absent, what needs them is named and left out.

hidden      one effect of a simulated device at 1, .5 and .2 of the noise; what the base model absorbs is left out
several     two and three effects at once
nothing     nothing is missing: thirteen noises, and devices that are not at rest when the record begins
planted     effects planted on measured records, sized to gain 40 in log likelihood; soil apart, reported only
odd         thermometers with noise of 0.1 K, steps of 0.5 K, a lag of 30 min, averages of ten rows; and rooms with
            thermostats whose logs are slow (rows every 150 and 300 s): with nothing missing, and with a knee
measured    records of the folder, learned on 50, 60, 70 and 80 %: refined and advised error on the 30 % that follow,
            and whether it lies in the range that is printed
coverage    95 % intervals of one row's bias and reading, of the gain and the step response, under eleven noises
live, C     a live stream and the exported C code give what `evaluate` gives
speed       ratios of processor time against the stored ones of `benchmarks/performance.py`
"""

import argparse
import itertools
import json
import os
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")

import hidden_effects
import interval_coverage
import live_cases
import null_records
import numpy as np
import pandas as pd
import performance
import planted_on_real
import real_records
import slow_logs
from common import asked, diagnosed, kinds
from firmware_runs import BOUND, errors, fitted, tool
from firmware_runs import KINDS as EXPORTED
from hidden_effects import DEVICES, SETTINGS
from joblib import Parallel, delayed
from scipy import stats
from threadpoolctl import threadpool_limits

from thermocorr.datasets import make_record
from thermocorr.effects import CATALOGUE
from thermocorr.judgement import levels

STORED = Path(__file__).with_name("value.json")
FIRST = 20_000  # first seed of the stored baseline
ERROR = 0.025  # probability that a question is called worse although nothing has changed
Answers = dict[str, Any]
Job = tuple[str, Callable[..., Answers | None], tuple[Any, ...]]
"""A name, and what gives the answers for it; None where the record cannot be made."""


class Question(NamedTuple):
    """One line of the table."""

    part: str
    name: str
    good: bool | None = True  # the answer that is hoped for; None for a figure, of which less is better
    counts: bool = True  # whether it can be worse, or is only reported


QUESTIONS = [
    Question("hidden", "right cause first"),
    Question("hidden", "right cause confirmed"),
    Question("hidden", "nothing missing, though confirmed", False),
    Question("several", "all that can be seen are found"),
    Question("several", "a cause that is not true", False),
    Question("nothing", "somebody accused", False),
    Question("nothing", "p <= 0.001", False),
    Question("planted", "named"),
    Question("planted", "confirmed"),
    Question("planted", "foreign column confirmed", False),
    Question("planted on soil", "named", True, False),
    Question("planted on soil", "confirmed", True, False),
    Question("planted on soil", "foreign column confirmed", False, False),
    Question("odd", "false cause, odd thermometer", False),
    Question("odd", "true knee found, odd thermometer"),
    Question("odd", "false cause, slow log", False),
    Question("odd", "true knee found, slow log"),
    Question("measured", "true cause first"),
    Question("measured", "true cause among"),
    Question("measured", "refine harms by 0.5 dB", False),
    Question("measured", "a range is printed"),
    Question("measured", "truth inside the printed range"),
    Question("measured", "advised harms by 0.5 dB", False),
    Question("measured", "refined over best known [dB]", None),
    Question("coverage", "bias of one row"),
    Question("coverage", "reading of one row"),
    Question("coverage", "gain"),
    Question("coverage", "step response"),
    Question("coverage", "width of readings [dB]", None),
    Question("live", "same as the whole record"),
    Question("C", "within its bound of Python"),
    Question("speed", "as fast as stored"),
]


# ---- simulated devices ----------------------------------------------------------------------------------------------
def hidden(kind: str, setting: str, seed: int, strength: float) -> Answers | None:
    found = hidden_effects.judge(kind, setting, seed, strength)
    if found is None or found["absorbed"]:
        return None
    return {
        "right cause first": found["first"],
        "right cause confirmed": found["confirmed"],
        "nothing missing, though confirmed": found["calm"] if found["confirmed"] else None,
    }


def several(setting: str, seed: int, n: int) -> Answers | None:
    found = hidden_effects.judge_several(setting, seed, n, 1.0, refined=False)
    if found is None:
        return None
    all_found = not found["missed"] if found["shown"] else None
    return {"all that can be seen are found": all_found, "a cause that is not true": bool(found["untrue"])}


def nothing(kind: str, seed: int, before: int) -> Answers:
    found = null_records.judged(kind, seed, 5000, list(SETTINGS)[seed % 3], before)
    return {"somebody accused": found["accused"], "p <= 0.001": float(str(found["p"])) <= 0.001}


# ---- thermometers that show something else than the device feels ----------------------------------------------------
ODD: dict[str, Callable[[np.ndarray, float, np.random.Generator], np.ndarray]] = {
    "noise of 0.1 K": lambda T, step, rng: T + 0.1 * rng.standard_normal(len(T)),
    "steps of 0.5 K": lambda T, step, rng: np.round(2 * T) / 2,
    "30 min away": lambda T, step, rng: pd.Series(T).ewm(alpha=-np.expm1(-step / 1800), adjust=False).mean().to_numpy(),
    "averages of ten rows": lambda T, step, rng: np.repeat(T.reshape(-1, 10).mean(axis=1), 10),
}
TRUE = ("lead", "delay", "rate", "thermal_lag", "lag_products")
"""What may be said of such a thermometer without untruth."""


def odd_thermometer(kind: str, setting: str, seed: int, knee: bool) -> Answers | None:
    step = SETTINGS[setting][1]
    try:
        record = make_record(
            6000, sampling_period=step, setting=setting, device=DEVICES[seed % 4], noise=0.2, seed=seed,
            effects={"hinge": 2.0} if knee else None,
        )  # fmt: skip
    except ValueError:
        return None
    seen = ODD[kind](record["temperature"].to_numpy(), step, np.random.default_rng([seed, 3]))
    X, y = record.drop(columns="reading").assign(temperature=seen), record["reading"]
    found = diagnosed(X, y)
    if knee:
        return {"true knee found, odd thermometer": "hinge" in kinds((*found.causes, *found.small))}
    return {"false cause, odd thermometer": not set(kinds(found.causes)) <= set(TRUE)}


def slow_log(room: str, seed: int, step: float, knee: bool) -> Answers:
    X, y = slow_logs.simulated(room, seed, step, 3000, "knee" if knee else "")
    found = diagnosed(X, y)
    if knee:
        return {"true knee found, slow log": "hinge" in kinds((*found.causes, *found.small))}
    return {"false cause, slow log": bool(found.causes)}


# ---- measured records -----------------------------------------------------------------------------------------------
CAUSES = {
    "vhd200 run10": "ambient_temp_degC", "vhd200 run9 and run10": "ambient_temp_degC",
    "hp34420a 100mV ch1": "room_temp_degC", "hp34420a 100mV ch2": "room_temp_degC", "oldtown 5 cm": "hinge",
    "oldtown 25 cm": "hinge", "heater log11.2": "heater_current_A", "groundwater river": "river",
    "groundwater well": "well", "groundwater step": "river", "groundwater change": "step",
}  # fmt: skip
"""Column of the documented cause, or its kind of effect."""
BEST = {
    "vhd200 run10": 0.108, "hp34420a 100mV ch1": 0.232, "hp34420a 100mV ch2": 0.248, "oldtown 5 cm": 0.62,
    "oldtown 25 cm": 0.61, "heater log11.2": 0.008, "gr1433": 0.214, "groundwater river": 0.092,
    "groundwater well": 0.126, "groundwater step": 0.235, "groundwater change": 0.222, "dam": 1.40,
}  # fmt: skip
"""Smallest error on the last 30 % that anybody has reached."""
QUICKLY = ("vhd200 run10", "hp34420a 100mV ch1", "hp34420a 100mV ch2", "groundwater well", "gr1433", "dam")
"""Records that take some seconds."""


def decibels(before: float, after: float) -> float:
    """How far an error falls [dB], positive where it does."""
    return float(20 * np.log10(before / after))


def measured(folder: str, name: str, share: float) -> Answers:
    X, y, temperature, n = real_records.every(folder)[name]
    usual, n = share == real_records.SHARE, real_records.learned(X, n, share)
    found, before, after = real_records.refined(X, y, temperature, n)
    causes = found.diagnoses[0].causes
    named = [CAUSES.get(name) in planted_on_real.name_of(cause.effect).split(":") for cause in causes]
    said = real_records.answered(X, y, temperature, n)
    printed = bool(said) and bool(np.isfinite(said["low"]))
    known = name in CAUSES and usual
    return {
        "true cause first": bool(named and named[0]) if known else None,
        "true cause among": any(named) if known else None,
        "refine harms by 0.5 dB": decibels(before, after) < -0.5,
        "a range is printed": printed,
        "truth inside the printed range": said["low"] <= said["truth"] <= said["high"] if printed else None,
        "advised harms by 0.5 dB": said["truth"] > 10**0.025 * min(said["given"], said["without"]) if said else None,
        "refined over best known [dB]": -decibels(BEST[name], after) if name in BEST and usual else None,
    }


def planted(folder: str, name: str, kind: str, seed: int) -> Answers | None:
    case = planted_on_real.plant(folder, name, kind, seed, 40.0)
    if case is None:
        return None
    found = planted_on_real.judged(case)
    return {"named": found["named"], "confirmed": found["confirmed"], "foreign column confirmed": found["foreign"]}


# ---- promises -------------------------------------------------------------------------------------------------------
def coverage(kind: str, seed: int, searched: bool) -> Answers:
    found = interval_coverage.judged(kind, seed, 5000, searched)
    return {
        "bias of one row": bool(found["bias row"]),
        "reading of one row": bool(found["reading row"]),
        "gain": bool(found["gain"]),
        "step response": bool(found["step 600 s"]),
        "width of readings [dB]": decibels(found["reading u"], np.sqrt(found["reading e2"])),
    }


def live(number: int, first: int) -> Answers:
    return {"same as the whole record": not live_cases.case(first, number, Counter())}


def exported(kind: str) -> Answers:
    model, X = fitted(**EXPORTED[kind])
    kelvin = EXPORTED[kind].get("kelvin", False)
    with tempfile.TemporaryDirectory() as folder:
        return {"within its bound of Python": errors(model, X, folder, 20_000, kelvin=kelvin)[0] <= BOUND}


def speed(line: performance.Line) -> Answers:
    stored = performance.stored_ratio(json.loads(performance.STORED.read_text()), performance.key(line))
    with threadpool_limits(1):
        line.other()  # some of ours need what the other has fitted
        line.ours()
        return {"as fast as stored": performance.checked(line, stored) <= performance.WORSE * stored}


# ---- the table ------------------------------------------------------------------------------------------------------
def jobs(part: str, options: argparse.Namespace) -> Iterator[Job]:
    """Names of a part's records, and what judges each."""
    first, quick, folder, product = options.first, options.quick, options.records, itertools.product
    settings = list(SETTINGS)

    def seeds(few: int, many: int) -> range:
        return range(first, first + (few if quick else many))

    if part == "hidden":
        for seed, kind, strength in product(seeds(1, 4), CATALOGUE, (1.0, 0.5, 0.2)):
            for setting in settings[:2] if quick else settings:
                yield f"{kind} {setting} {seed} {strength:g}", hidden, (kind, setting, seed, strength)
    elif part == "several":
        for seed, n in product(seeds(4, 12), (2, 3)):
            setting = settings[(seed - first + n) % 3]
            yield f"{n} {setting} {seed}", several, (setting, seed, n)
    elif part == "nothing":
        for seed in seeds(4, 20):
            for kind in null_records.NOISES:
                yield f"{kind} {seed}", nothing, (kind, seed, 0)
            for kind in ("white", "2 %", "flicker") if (seed - first) % 2 == 0 else ():
                yield f"{kind} {seed}, not at rest", nothing, (kind, seed, 3000)
    elif part == "odd":
        for seed, kind, setting, knee in product(seeds(1, 4), ODD, SETTINGS, (False, True)):
            yield f"{kind} {setting} {seed}{' knee' * knee}", odd_thermometer, (kind, setting, seed, knee)
        for seed, room, step, knee in product(seeds(2, 8), slow_logs.ROOMS, (150.0, 300.0), (False, True)):
            yield f"{room} {step:g} s {seed}{' knee' * knee}", slow_log, (room, seed, step, knee)
    elif part == "measured":
        for name, share in product(
            QUICKLY if quick else real_records.every(folder), (0.7,) if quick else (0.5, 0.6, 0.7, 0.8)
        ):
            yield f"{name} {share:g}", measured, (folder, name, share)
    elif part in ("planted", "planted on soil"):
        soil = part == "planted on soil"
        names = [name for name, *_ in planted_on_real.backgrounds(folder) if name.startswith("oldtown") == soil]
        for seed, (k, kind) in product(seeds(1, 1 if soil else 3), enumerate(planted_on_real.KINDS)):
            for name in (names * 2)[k % len(names) :][: 0 if soil else 3] if quick else names:
                yield f"{kind} on {name} {seed}", planted, (folder, name, kind, seed)
    elif part == "coverage":
        for seed, kind, searched in product(seeds(1, 12), interval_coverage.KINDS, (False, True)):
            yield f"{kind} {seed}{' searched' * searched}", coverage, (kind, seed, searched)
    elif part == "live":
        for number in range(20 if quick else 200):
            yield f"{number} {first}", live, (number, first)
    elif part == "C":
        for kind in list(EXPORTED)[:: 6 if quick else 1]:
            yield kind, exported, (kind,)
    else:
        for line in performance.lines(True)[:: 4 if quick else 1]:
            yield performance.key(line), speed, (line,)


def change(level: str) -> None:
    """Give a threshold of the judgement another value, such as LEVEL=0.02, wherever it is used."""
    name, value = level.split("=")
    kind = type(vars(levels)[name])
    for module in [module for key, module in sys.modules.items() if key.startswith("thermocorr.judgement")]:
        if name in vars(module):
            setattr(module, name, kind(float(value)))


def answered(part: str, job: Job, level: str) -> tuple[str, str, Answers | None, float]:
    """A record's answers, and the processor time that they took."""
    warnings.simplefilter("ignore")
    if level:
        change(level)
    name, judge, arguments = job
    began = sum(os.times()[:4])
    return part, name, judge(*arguments), sum(os.times()[:4]) - began


def lost(question: Question, now: dict[str, Any], stored: dict[str, Any]) -> bool:
    """Whether it is worse, beyond what chance makes of equal states."""
    common = now.keys() & stored.keys()
    if question.good is None:
        change = np.array([now[name] - stored[name] for name in common])
        return len(change) > 1 and change.std() > 0 and stats.ttest_1samp(change, 0, alternative="greater")[1] <= ERROR
    wrong = {name: bool(answer) != question.good for name, answer in now.items()}
    before = {name: bool(answer) != question.good for name, answer in stored.items()}
    if common:
        worse, better = (sum(a[name] and not b[name] for name in common) for a, b in ((wrong, before), (before, wrong)))
        return worse > 0 and stats.binomtest(worse, worse + better, 0.5, alternative="greater").pvalue <= ERROR
    counts = [[sum(of.values()), len(of) - sum(of.values())] for of in (wrong, before)]
    return bool(stats.fisher_exact(counts, alternative="greater")[1] <= ERROR)


def shown(question: Question, answers: dict[str, Any]) -> tuple[str, str]:
    """A question's figure and its interval."""
    values = list(answers.values())
    if not values:
        return "-", ""
    if question.good is None:
        half = stats.t.ppf(0.975, len(values) - 1) * np.std(values, ddof=1) / len(values) ** 0.5 if values[1:] else 0.0
        return f"{np.mean(values):.2f} ({len(values)})", f"{np.mean(values) - half:.2f} to {np.mean(values) + half:.2f}"
    k, n = sum(map(bool, values)), len(values)
    low, high = stats.binomtest(k, n).proportion_ci(0.95)
    return f"{k} of {n}", f"{100 * low:.0f} to {100 * high:.0f} %"


def table(found: dict[str, dict[str, Answers]], stored: dict[str, dict[str, Answers]], verbose: bool) -> int:
    """Print it; the number of questions that are worse."""
    print(f"{'part':16s}{'question':34s}{'now':>13s}  {'95 %':15s}{'stored':>13s}")
    n_worse = 0
    for question in QUESTIONS:
        now, was = (
            {name: answers[question.name] for name, answers in of.get(question.part, {}).items()
             if answers.get(question.name) is not None} for of in (found, stored)
        )  # fmt: skip
        if question.part not in found or not now:
            continue
        common = {name: was[name] for name in was if name in now} or was
        worse = question.counts and bool(was) and lost(question, now, was)
        n_worse += worse
        figure, interval = shown(question, now)
        said = "WORSE" if worse else "" if question.counts else "reported only"
        before = shown(question, common)[0]
        print(f"{question.part:16s}{question.name:34s}{figure:>13s}  {interval:15s}{before:>13s}  {said}".rstrip())
        if verbose and question.good is not None:
            for name, answer in now.items():
                if bool(answer) != question.good:
                    print(f"{'':18s}{name}{'' if was.get(name) == answer else '  (new)'}")
    return n_worse


def main() -> int:
    parts = list(dict.fromkeys(question.part for question in QUESTIONS))
    options = asked(
        __doc__, quick=False, first=FIRST, records="../shared/records", parts=parts, jobs=os.cpu_count(), write=False,
        level="", verbose=False,
    )  # fmt: skip
    warnings.simplefilter("ignore")
    chosen = list(options.parts)
    if options.level:
        name, _, value = options.level.partition("=")
        if not value or not isinstance(vars(levels).get(name), (int, float)):
            names = [name for name, value in vars(levels).items() if isinstance(value, (int, float))]
            sys.exit(f"--level takes NAME=VALUE, got {options.level!r}. The names are {', '.join(names)}.")
        print(f"With {name} = {value} in place of {vars(levels)[name]}")
    if not Path(options.records).is_dir():
        absent = [part for part in chosen if part.startswith(("planted", "measured"))]
        chosen = [part for part in chosen if part not in absent]
        if absent:
            print(f"No folder {options.records!r}: {', '.join(absent)} left out. Name it with --records.")
    if "C" in chosen and not tool("gcc"):
        chosen.remove("C")
        print("No gcc: part C left out.")
    # timings run alone
    plan = [(part, job) for part in chosen if part != "speed" for job in jobs(part, options)]
    rows = Parallel(n_jobs=options.jobs, return_as="generator_unordered")(
        delayed(answered)(*job, options.level) for job in plan
    )
    found: dict[str, dict[str, Answers]] = {part: {} for part in chosen}
    spent: Counter[str] = Counter()
    for part, name, answers, seconds in rows:
        spent[part] += seconds
        if answers is not None:
            found[part][name] = {
                key: value if value is None or isinstance(value, float) else bool(value)
                for key, value in answers.items()
            }
    for job in jobs("speed", options) if "speed" in chosen else ():
        part, name, answers, seconds = answered("speed", job, options.level)
        found[part][name], spent[part] = answers or {}, spent[part] + seconds
    stored = json.loads(STORED.read_text()) if STORED.exists() else {}
    n_worse = table(found, stored, options.verbose)
    print("processor time: " + ", ".join(f"{part} {seconds:.0f} s" for part, seconds in spent.items())
          + f"; in all {sum(spent.values()) / 60:.1f} min")  # fmt: skip
    if options.write:
        kept = {part: dict(sorted(answers.items())) for part, answers in found.items()}
        STORED.write_text(json.dumps({**stored, **kept}, indent=0) + "\n")
        return 0
    print(f"{n_worse} questions are worse." if n_worse else "Nowhere worse than stored.")
    return int(n_worse > 0)


if __name__ == "__main__":
    sys.exit(main())
