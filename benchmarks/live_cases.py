"""Random cases of one promise: a live stream says what the whole record says, however its samples arrive.

    python benchmarks/live_cases.py                       # 2000 cases, six minutes
    python benchmarks/live_cases.py --seed 1 --only 417   # one of them again

stream: a model of a part of a random log (gaps, missing values, runs, six layouts of time) meets a stream that begins
anywhere, in pieces, with restarts, refused rows and damaged dates; expected is `evaluate` on its sound rows. rows: the
same without times, against a twin with times. command: `correct` writes the readings of `analyze`, to the last digit.
"""

import contextlib
import io
import json
import sys
import tempfile
import warnings
from collections import Counter
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from common import asked
from living import COLUMNS, DAY, GAP, NS, Layout, differences, gap_of, random_log
from sklearn.preprocessing import SplineTransformer

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordWarning, save_model
from thermocorr import effects as fx
from thermocorr.command import correct as correct
from thermocorr.command.cli import main as command

TIMED = ("dates", "zone", "spans", "seconds", "text")
LABELS: list[list[Any]] = [list("abcdef"), [3, 1, 2, 7, 5, 4], [0.5, 1.5, 1e6, 2.25, 7.0, -1.0]]
LABELS += [pd.date_range("2024", periods=6).tolist(), [day.date() for day in pd.date_range("2024", periods=6)]]
WRITTEN_LABELS = [list("abcdef"), list("124689"), ["007", "08", "9", "10", "1e3", "2.50"], list("ab1234")]


def random_model(rng, layout: Layout, max_gap: float | None, run: bool) -> DynamicBiasRegressor:
    """Unfitted. The same generator and another layout of time make its twin."""
    s, t, degree, wet, dry = layout.step, layout.step * 10 ** rng.uniform(0.5, 2), int(rng.integers(1, 4)), *COLUMNS[1:]
    every = [
        fx.StaticPolynomial(degree + 1, lowest_power=degree + 1), fx.ThermalLag([2 * t]), fx.InitialTransient([t]),
        fx.LagProducts([t, 9 * t], temperature_products=True), fx.Rate(), fx.Rate(3 * s), fx.Delay(0.4 * s),
        fx.Delay(25 * s), fx.Covariate(wet), fx.Covariate(dry, power=2), fx.LaggedCovariate(wet, [t, 5 * t]),
        fx.LaggedCovariate(dry, [t], "zero_order", 2), fx.Interaction(wet), fx.Drift(bool(rng.integers(2))),
        fx.LogAgeing(30 * s, True), fx.SensitivityDrift(), fx.Step(100 * s, True), fx.Hysteresis(0.6),
        fx.Hinge(22.8, "below", [t, 9 * t]), fx.Hinge(23.1), fx.Periodic(200 * s, harmonics=3), SplineTransformer(3),
    ]  # fmt: skip
    return DynamicBiasRegressor(
        None, (s * 10 ** np.sort(rng.uniform(0.3, 2.7, rng.integers(1, 5)))).tolist(), degree,
        effects=[every[k] for k in rng.choice(len(every), rng.integers(5), replace=False)],
        products=bool(rng.random() < 0.25),
        alpha=float(rng.choice([0.0, 1e-6])),
        max_gap=max_gap, run="run" if run else None, **layout.keywords,
    )  # fmt: skip


def twins(rng, layout: Layout, max_gap: float | None, log: pd.DataFrame) -> list[DynamicBiasRegressor]:
    """A fitted model, and the same with times; where it has some, they are one."""
    seed, models = int(rng.integers(2**32)), []
    for way in dict.fromkeys((layout, layout.with_times())):
        model = random_model(np.random.default_rng(seed), way, max_gap, "run" in log)
        models.append(model.fit(way.dressed(log), log["reading"].to_numpy()))
    models[-1].pipeline_.steps[1] = models[0].pipeline_.steps[1]  # the last digits of a fit are chance
    return [models[0], models[-1]]


def stream_case(rng, counts: Counter, timed: bool = True) -> list[str]:
    """A fit to a part of a log, and a stream."""
    layout, n = Layout.random(rng, *(TIMED if timed else ["rows"])), int(rng.integers(260, 560))
    labels = LABELS[rng.integers(len(LABELS))] if rng.random() < 0.4 else None
    max_gap = None if rng.random() < 0.4 else float(rng.choice([1, 3, 12, 100, 5000])) * layout.step
    log, n_fit = random_log(rng, layout, n, max_gap, labels), int(rng.uniform(0.45, 0.7) * n)
    given = "" if timed else str(rng.choice(["at once", "pieces"]))
    if given == "at once":  # rows may be alike
        log["temperature"] = log["temperature"].round(rng.integers(1, 15))
    model, judge = twins(rng, layout, max_gap, log[:n_fit])
    begin = ["other", "before", "late", "gap", "start", "middle", "end"][rng.integers(0 if timed else 4, 7)]
    begin = "end" if given == "pieces" else begin  # one row cannot tell which one it repeats
    rows = {"start": 0, "before": 0, "late": n_fit, "gap": n_fit + int(rng.integers(2, 60)), "end": n_fit}
    row, days = rows.get(begin, int(rng.integers(n_fit - 40))), {"late": 40, "before": -rng.uniform(0, 2)}.get(begin, 0)
    stream = log[row:].reset_index(drop=True).assign(fate="sound")
    stream["temperature"] += 0.01 * (begin == "other")
    more = {"average": int(rng.integers(1, 30)), "track": float(layout.step * 10 ** rng.uniform(0, 3))}
    shift = int(days * DAY // (layout.step * NS))  # rows
    stream["ns"] += int(shift * layout.step * NS)
    if timed:
        stream = disturbed(rng, model, log[:n_fit], stream)
    counts.update(stream["fate"] + " rows")
    got = fed(rng, OnlineCorrector(model, **more), layout, stream, given == "at once")
    judges = (model, layout) if given == "at once" else (judge, layout.with_times())
    return differences(got, *judges, stream, more)


def disturbed(rng, model, fitted: pd.DataFrame, stream: pd.DataFrame) -> pd.DataFrame:
    """The rows of a stream, with rows among them that must be refused, and damaged dates."""
    rows, result, damaged = stream.to_dict("records"), [], {}
    for _ in range(rng.integers(3)):
        place, row = damage(rng, model, fitted, stream)
        if row is not None and not damaged.keys() & {place - 1, place, place + 1}:
            damaged[place] = row
    share = rng.choice([0.0, 0.02, 0.2])
    for k, row in enumerate([*rows, None]):
        for last, often in ((damaged.get(k), 0.3), (row, share)):
            result += [] if last is None else [last]
            if last is not None and rng.random() < often:
                result.append(refused(rng, [early for early in rows[:k] if early.get("run") == last.get("run")], last))
    return pd.DataFrame(result)


def refused(rng, before: list[dict], last: dict) -> dict:
    """A row with the time of the last one, or with an earlier one: of a row before it, or of another decade."""
    if not before or rng.random() < 0.5:
        return {**last, "fate": "stale time"}
    row = before[-1 if rng.random() < 0.5 else rng.integers(len(before))]
    return {**row, "ns": row["ns"] - int(rng.choice([0, 20 * 365 * DAY])), "fate": "backward time"}


def damage(rng, model, fitted: pd.DataFrame, stream: pd.DataFrame) -> tuple[int, dict | None]:
    """A row with a false date, and before which row it comes; None where no stream could know it."""
    n, begins = len(stream), stream["run"] != stream["run"].shift() if "run" in stream else np.zeros(len(stream))
    place = int(rng.choice([0, n, *np.flatnonzero(begins)]) if rng.random() < 0.4 else rng.integers(n + 1))
    row = stream.iloc[place - 1 if place == n or (place and rng.random() < 0.5) else place].to_dict()
    before, after, known = (
        rows["ns"][rows["run"] == row["run"]] if "run" in rows else rows["ns"]
        for rows in (stream[:place], stream[place : place + 1], fitted.dropna(subset=COLUMNS))
    )
    periodic = any(isinstance(effect, fx.Periodic) for effect in model.effects)  # loses digits in half a century
    row["ns"] += int(rng.choice([31 * DAY if periodic else 70 * 365 * DAY, DAY, 31 * DAY]))
    row["temperature"] += float(rng.choice([0, 0.3]))
    if not len(after):  # nothing will speak against it
        return place, row if len(before) and row["ns"] > before.iloc[-1] else None
    last = before.iloc[-1] if len(before) else known[known <= row["ns"]].max()  # NaN where there is none
    told = row["ns"] > after.iloc[0] and not (row["ns"] - last) / NS <= gap_of(model)
    return place, {**row, "fate": "damaged"} if told else None


def fed(rng, live: OnlineCorrector, layout: Layout, log: pd.DataFrame, at_once: bool) -> pd.DataFrame:
    """What a live corrector says of the rows, in pieces with restarts, or at once."""
    jumps = np.flatnonzero(np.abs(np.diff(log["ns"], prepend=log["ns"][0])) > GAP * layout.step * NS) + 1
    edges = {0, len(log), *rng.integers(0, len(log), rng.integers(12)), *jumps[rng.random(len(jumps)) < 0.7]}
    log = log.assign(temperature=log["temperature"].fillna(rng.choice([np.nan, np.inf])))
    X, y, parts = layout.dressed(log), log["reading"].to_numpy(), []
    for low, high in pairwise([0, len(log)] if at_once else sorted(edges)):
        if not at_once and high - low < 120 and rng.random() < 0.6:
            parts.append(one_by_one(live, layout, X[low:high], y[low:high], rng))
        else:
            parts.append(live.update_many(X[low:high], y[low:high]))
        if rng.random() < 0.4:
            live = OnlineCorrector.from_state(live.model, json.loads(json.dumps(live.state(), allow_nan=False)))
    return pd.concat(parts, ignore_index=True)


def one_by_one(live: OnlineCorrector, layout: Layout, X, y, rng) -> pd.DataFrame:
    names = [*live.columns, *(["run"] if "run" in X else [])]
    rows = zip(layout.times(X, rng), X["temperature"], y, *(X[name] for name in names), strict=True)
    samples = [live.update(*row[:3], **dict(zip(names, row[3:], strict=True))) for row in rows]
    return pd.DataFrame([{**sample._asdict(), "flag": sample.flag} for sample in samples]).drop(columns="flags")


def command_case(rng, counts: Counter) -> list[str]:
    """A log in a file: `correct` writes what `analyze` wrote, or what `evaluate` says, to the last digit.

    But where times are seconds: files round them to dates of the nearest microsecond.
    """
    labels = WRITTEN_LABELS[rng.integers(len(WRITTEN_LABELS))] if rng.random() < 0.4 else None
    layout = Layout.random(rng, "text", "seconds", "rows")
    max_gap = None if rng.random() < 0.5 else float(rng.choice([3, 12, 100])) * layout.step
    log = random_log(rng, layout, int(rng.integers(300, 500)), max_gap, labels)
    log["temperature"] = log["temperature"].round(rng.choice([1, 3, 14]))
    with tempfile.TemporaryDirectory() as folder:
        path, known, model, out = (f"{folder}/{name}" for name in ("log.csv", "corrected.csv", "model.json", "out.csv"))
        layout.dressed(log).assign(reading=log["reading"]).to_csv(path, index=False, na_rep=rng.choice(["", "NaN"]))
        if rng.random() < 0.5:
            given = ("--reading", "reading", "--out", folder)
            said = run("analyze", path, "--variant", "dynamic-linear", *given, *options(rng, layout, max_gap, labels))
        else:
            table, fitted, said = pd.read_csv(path), random_model(rng, layout, max_gap, labels is not None), []
            fitted.set_params(effects=[effect for effect in fitted.effects if isinstance(effect, fx.Effect)])
            fitted.fit(table, table["reading"]).evaluate(table, table["reading"]).to_csv(known)
            save_model(fitted, model)
        said += run("correct", "--model", model, path, "--out", out)
        if said:  # what has to wait for later samples is rightly refused
            return [text for text in said if "looks at samples that come later" not in text]
        got, expected = (pd.read_csv(file, dtype=str, keep_default_na=False)["corrected"] for file in (out, known))
    counts["lines of files"] += len(got)
    near = 1e-9 if layout.kind == "seconds" else 0.0
    pairs = enumerate(zip(got, expected, strict=True))
    return [f"line {k + 2} has {a}, not {b}" for k, (a, b) in pairs if a != b and not _alike(a, b, near)][:3]


def _alike(one: str, other: str, near: float) -> bool:
    """True if two numbers are the same but for a share of their size."""
    return bool(one and other) and abs(float(one) - float(other)) <= near * abs(float(other))


def options(rng, layout: Layout, max_gap: float | None, labels) -> list:
    time = ["--sampling-period", layout.step] if layout.kind == "rows" else ["--time", layout.keywords["time"]]
    more = [*([] if max_gap is None else ["--max-gap", max_gap]), *([] if labels is None else ["--run", "run"])]
    more += ["--time-constants", f"{5 * layout.step:g},{60 * layout.step:g}"]
    return [*time, *more, *[[], ["--refine"]][rng.integers(2)]]


def run(*arguments) -> list[str]:
    """Run the command; what it complains of."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as errors:
        status = command([str(argument) for argument in arguments])
    return [f"exit status {status}: {errors.getvalue()}"] if status else []


def case(seed: int, number: int, counts: Counter) -> list[str]:
    """Run one case; sentences on what differs."""
    rng, kind = np.random.default_rng([seed, number]), {0: "command", 1: "rows", 2: "rows"}.get(number % 10, "stream")
    counts[f"{kind} cases"] += 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordWarning)
        return command_case(rng, counts) if kind == "command" else stream_case(rng, counts, kind == "stream")


def main() -> int:
    options, counts = asked(__doc__, cases=2000, seed=0, only=int), Counter()
    for number in range(options.cases) if options.only is None else [options.only]:
        try:
            found = case(options.seed, number, counts)
        except Exception as error:
            if options.only is not None:
                raise
            found = [f"failed: {error!r}"]
        counts["cases that differ"] += bool(found)
        print("".join(f"case {number}: {text}\n" for text in found), end="", flush=True)
    print(", ".join(f"{count:,} {what}" for what, count in counts.items()))
    return int(counts["cases that differ"] > 0)


if __name__ == "__main__":
    sys.exit(main())
