"""Random cases of one promise: a live stream says what the whole record says, however its samples arrive.

    python benchmarks/live_cases.py                       # 2000 cases, six minutes
    python benchmarks/live_cases.py --seed 1 --only 417   # one of them again

stream: a model of a part of a random log (gaps, missing values, runs, six layouts of time) meets a stream that begins
anywhere, in pieces, with restarts, refused rows and damaged dates; expected is `evaluate` on its sound rows. rows: the
same without times, against a twin with times. command: `correct` writes the readings of `analyze`, to the last digit.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
import tempfile
import warnings
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
import pandas as pd
from sklearn.preprocessing import SplineTransformer

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordWarning, save_model
from thermocorr import effects as fx
from thermocorr.command import correct
from thermocorr.command.cli import main as command
from thermocorr.records.files import read_table

NS, DAY, GAP, SUSPECT = 1_000_000_000, 86_400 * 1_000_000_000, 10, 1000  # ns, ns, usual steps, gaps
CLOSE, DIGITS = 1e-12, 1e-15  # shares of the range, and of the sum of all terms, that two ways may be apart
TICKS = {"s": NS, "ms": NS // 1000, "us": 1000, "ns": 1}
TIMED, COLUMNS = ("dates", "zone", "spans", "seconds", "text"), ["temperature", "humidity", "pressure"]
ZONES = {"Europe/Berlin": ("2024-03-31T01", "2024-10-27T01"), "America/New_York": ("2024-03-10T07", "2024-11-03T06")}
LABELS: list[list[Any]] = [list("abcdef"), [3, 1, 2, 7, 5, 4], [0.5, 1.5, 1e6, 2.25, 7.0, -1.0]]
LABELS += [pd.date_range("2024", periods=6).tolist(), [day.date() for day in pd.date_range("2024", periods=6)]]
WRITTEN_LABELS = [list("abcdef"), list("124689"), ["007", "08", "9", "10", "1e3", "2.50"], list("ab1234")]


class Layout(NamedTuple):
    """How rows carry their times."""

    kind: str
    step: float
    unit: str
    zone: str | None
    offset: float

    @classmethod
    def random(cls, rng, *kinds: str) -> Layout:
        kind, step = str(rng.choice(kinds)), float(rng.choice([0.25, 1.0, 15.0, 60.0, 600.0]))
        zone = str(rng.choice(list(ZONES))) if kind == "zone" or (kind == "text" and rng.random() < 0.7) else None
        unit = str(rng.choice(["ns", "us", "ms", "s" if step >= 1 else "ms"]))
        return cls(kind, step, unit, zone, float(rng.choice([0.0, 0.1, 1e9, -12.5])))

    @property
    def keywords(self) -> dict[str, Any]:
        more = {"seconds": {"time": "s"}, "text": {"time": "stamp"}, "rows": {"sampling_period": self.step}}
        return more.get(self.kind, {})

    def with_times(self) -> Layout:
        return self._replace(kind="seconds", offset=0.0) if self.kind == "rows" else self

    def dressed(self, log: pd.DataFrame) -> Any:
        """The log as a user holds it, its readings left out."""
        X = log[[*COLUMNS, *(["run"] if "run" in log else [])]].reset_index(drop=True)
        if self.kind in ("rows", "seconds"):
            return X if self.kind == "rows" else X.assign(s=self.offset + log["ns"].to_numpy() / NS)
        if self.kind == "spans":
            return X.set_axis(pd.TimedeltaIndex(log["ns"].to_numpy().astype("m8[ns]")).as_unit(self.unit))
        index = pd.DatetimeIndex(log["ns"].to_numpy().astype("M8[ns]")).as_unit(self.unit)
        index = index if self.zone is None else index.tz_localize("UTC").tz_convert(self.zone)
        return X.assign(stamp=[time.isoformat() for time in index]) if self.kind == "text" else X.set_axis(index)

    def times(self, X, rng) -> list:
        """Time of every row as `update` may get it."""
        if self.kind in ("rows", "seconds", "text"):
            return [None] * len(X) if self.kind == "rows" else X[self.keywords["time"]].tolist()
        forms = [lambda t: t, str, pd.Timedelta.to_timedelta64 if self.kind == "spans" else pd.Timestamp.isoformat]
        if self.zone is not None:
            forms += [lambda t: t.tz_convert("Asia/Tokyo"), lambda t: t if t.nanosecond else t.to_pydatetime()]
        return [forms[rng.integers(len(forms))](t) for t in X.index]


def random_log(rng, layout: Layout, n: int, max_gap: float | None, labels: list | None) -> pd.DataFrame:
    """Times [ns], temperature, two covariates, the reading and, with labels, the run."""
    tick, step, timed = TICKS[layout.unit], layout.step * NS, layout.kind != "rows"
    jitter = float(rng.choice([0.0, 0.5, 0.9])) * timed
    steps = np.maximum(np.round(step * (1 + jitter * rng.uniform(-1, 1, n)) / tick), 1).astype(np.int64) * tick
    gaps = [8 * step, 11 * step, 200 * step, 3 * DAY, rng.uniform(1, 1e5) * step]
    gaps += [] if max_gap is None else [max_gap * NS, max_gap * NS + tick]
    for at in rng.integers(1, n, rng.integers(6) * timed):
        steps[at] = max(int(rng.choice(gaps)) // tick, 1) * tick
    ns = np.cumsum(steps) - steps[0]
    changes = ZONES[layout.zone or "Europe/Berlin"]  # clocks are changed somewhere in the log
    change = pd.Timestamp(changes[rng.integers(2)]).as_unit("ns").value - int(rng.random() * ns[-1])
    origin = {"rows": 0, "seconds": 0, "spans": int(rng.choice([0, -5, 10**6])) * tick}.get(layout.kind, change)
    age, noise = ns / step, rng.normal(size=(5, n))
    T = 23 + np.sin(age / rng.uniform(20, 120)) + 0.05 * np.cumsum(noise[0])
    log = pd.DataFrame({"ns": ns + origin // tick * tick, "temperature": T, "humidity": 45 + np.cumsum(noise[1]) / 3})
    log["pressure"] = 1013 + np.sin(age / 31) + 0.1 * noise[2] if rng.random() < 0.7 else (noise[3] > 0) * 1.0
    log["reading"] = 10 + log["temperature"].ewm(alpha=0.05).mean() / 3 + T / 9 + 0.01 * noise[4]
    for name in log.columns[1:]:
        for at in rng.integers(0, n - 25, rng.integers(4) * (rng.random() < 0.6)):
            absurd = rng.random() < 0.3 and name in ("temperature", "reading")
            log.loc[at : at + rng.choice([0, 0, 1, 20]), name] = rng.choice([9.9e37, 85.0, 60.0]) if absurd else np.nan
    if labels is None:
        return log
    edges = np.sort(rng.choice(np.arange(5, n - 5), rng.integers(1, 5), replace=False))
    if timed and rng.random() < 0.3:  # the last run begins before the one before has ended
        log.loc[edges[-1] :, "ns"] -= log["ns"][edges[-1]] - log["ns"][edges[-1] // 2]
    return log.assign(run=pd.Series([labels[k] for k in np.searchsorted(edges, np.arange(n), side="right")]))


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
        products=bool(rng.random() < 0.25), initial_state=str(rng.choice(["fit", "equilibrium", "zero"])),
        hold=str(rng.choice(["first_order", "zero_order"])), longest_decay_share=float(rng.choice([0.04, 1.0])),
        alpha=float(rng.choice([0.0, 1e-6])), washout=["auto", 7.0, 120 * s][rng.integers(3)],
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
    given = "" if timed else str(rng.choice(["first_row", "at once", "pieces"]))
    if given in ("first_row", "at once"):  # rows may be alike
        log["temperature"] = log["temperature"].round(rng.integers(1, 15))
    alike = log["temperature"][:n_fit].dropna().duplicated().any()  # one row cannot tell which one it repeats
    model, judge = twins(rng, layout, max_gap, log[:n_fit])
    begin = ["other", "before", "late", "gap", "start", "middle", "end"][rng.integers(0 if timed else 2, 7)]
    rows = {"start": 0, "before": 0, "late": n_fit, "gap": n_fit + int(rng.integers(2, 60)), "end": n_fit}
    row, days = rows.get(begin, int(rng.integers(n_fit - 40))), {"late": 40, "before": -rng.uniform(0, 2)}.get(begin, 0)
    stream = log[row:].reset_index(drop=True).assign(fate="sound")
    stream["temperature"] += 0.01 * (begin == "other")
    more = {"average": int(rng.integers(1, 30)), "track": float(layout.step * 10 ** rng.uniform(0, 3))}
    shift = int(days * DAY // (layout.step * NS))  # rows
    stream["ns"] += int(shift * layout.step * NS)
    if timed:
        stream = disturbed(rng, model, log[:n_fit], stream)
    elif given == "first_row" or (given == "pieces" and (begin in ("late", "gap") or alike)):
        more["first_row"] = row + shift
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


def differences(got: pd.DataFrame, judge, layout: Layout, log: pd.DataFrame, ways: dict) -> list[str]:
    """Sentences on rows that differ from what the whole record says."""
    sound = (log["fate"] == "sound").to_numpy()
    expected, got_sound = whole(judge, layout, log[sound]), got[sound].reset_index(drop=True)
    averages(expected, got_sound["flag"], ways, judge.intercept_)
    found, scale = apart(got_sound, expected), span([judge.intercept_, *expected["corrected"]])
    # a tracked U0 counts time in seconds since 1970, whose last digit is a quarter of a microsecond
    for name, close in (("smoothed", CLOSE), ("reference", CLOSE + 1e-6 / ways["track"])):
        found += unequal(name, got_sound[name], expected[name], close * scale + expected["slack"])
    for k in np.flatnonzero(~sound):
        if log["fate"][k] != "damaged":
            again = ["stale time"] * (log["ns"][k] in set(log["ns"][:k][sound[:k]]))  # rows behind it may not have come
            said = got["flag"][k] in (log["fate"][k], "sentinel", "spike", *again)
            if not said or got.loc[k, ["corrected", "bias"]].notna().any():
                found.append(f"row {k} should be refused as {log['fate'][k]!r}, is {got.loc[k].to_dict()}")
            continue
        so_far = pd.concat([log[:k][sound[:k]], log[k : k + 1]])
        if len(so_far.dropna(subset=COLUMNS)):  # else there is no record
            found += [f"damaged row {k}: {text}" for text in apart(got[k : k + 1], whole(judge, layout, so_far))]
    return found


def whole(model, layout: Layout, log: pd.DataFrame) -> pd.DataFrame:
    """`evaluate` on the whole record, its bias, the flags that a stream may give, and what rounding may cost."""
    X, U = layout.dressed(log), log["reading"].to_numpy()
    result = model.evaluate(X, U).reset_index(drop=True).assign(bias=np.asarray(model.bias(X)))
    sizes = np.abs(model.features_.transform(X)) @ np.abs(model.coef_)
    result["slack"] = DIGITS * (np.nanmax(sizes) + np.nanmax(np.abs(U), initial=0.0))
    stamps, unit = (X["s"].to_numpy(), 1) if layout.kind == "seconds" else (log["ns"].to_numpy(), NS)
    first = (log["run"] != log["run"].shift()).to_numpy() if "run" in log else result.index == 0
    gone, flags = result["model"].isna() & (result["flag"] != "no temperature"), []  # as if it had not come
    last = np.maximum.accumulate(np.r_[-1, np.where(gone, -1, np.arange(len(gone)))[:-1]])  # the row before that came
    leaps = np.where(last < 0, stamps, stamps - stamps[last]) / unit
    for flag, step, begins, away in zip(result["flag"], leaps / gap_of(model), first | (last < 0), gone, strict=True):
        said = {"suspect time"} if step > SUSPECT else {flag or "gap"} if step > 1 else {flag}
        said = {flag, flag or "gap", "suspect time"} if begins else said  # how far it lies behind is not looked up
        flags.append({flag} if away or flag == "no temperature" else said)
    return result.assign(flags=flags, steps=np.diff(stamps, prepend=0) / unit)


def averages(expected: pd.DataFrame, flags, ways: dict, value: float) -> None:
    """Moving average, eq. (26), and tracked U0, by definition."""
    known, since, began, values = expected["corrected"].dropna(), 0.0, False, []
    expected["smoothed"] = known.rolling(ways["average"], min_periods=1).mean().reindex(expected.index)
    for step, corrected, flag in zip(expected["steps"], expected["corrected"], flags, strict=True):
        since += step
        if flag in ("", "gap"):
            value -= np.expm1(-max(since, 0.0) / ways["track"]) * (corrected - value) * began
            since, began = 0.0, True
        values.append(value)
    expected["reference"] = values


def apart(got: pd.DataFrame, expected: pd.DataFrame) -> list[str]:
    """Where corrected readings, bias and flags differ from the last rows of what is expected."""
    close = {name: CLOSE * span(expected[name]) + expected["slack"][0] for name in ("bias", "corrected")}
    expected, found = expected[len(expected) - len(got) :].reset_index(drop=True), []
    for name in close:
        found += unequal(name, got[name], expected[name], sum(close.values()))
    for k, (flag, flags) in enumerate(zip(got["flag"], expected["flags"], strict=True)):
        found += [] if flag in flags else [f"flag of row {k} is {flag!r}, not in {flags}"]
    return found[:4]


def unequal(name: str, got, expected, close) -> list[str]:
    got, expected = np.asarray(got, float), np.asarray(expected, float)
    wrong = np.flatnonzero((np.isnan(got) != np.isnan(expected)) | (np.abs(got - expected) > close))
    return [f"{name} differs in {len(wrong)} rows, first {k}: {got[k]}, not {expected[k]}" for k in wrong[:1]]


def gap_of(model) -> float:
    """A longer step is a gap [s]."""
    return GAP * model.features_.history_.usual_step if model.max_gap is None else model.max_gap


def span(values) -> float:
    return float(np.nanmax(values) - np.nanmin(values)) if np.isfinite(values).any() else 0.0


def command_case(rng, counts: Counter) -> list[str]:
    """A log in a file: `correct` writes what `analyze` wrote, or what `evaluate` says, to the last digit."""
    labels = WRITTEN_LABELS[rng.integers(len(WRITTEN_LABELS))] if rng.random() < 0.4 else None
    layout = Layout.random(rng, "text", "seconds", "rows")
    max_gap = None if rng.random() < 0.5 else float(rng.choice([3, 12, 100])) * layout.step
    log = random_log(rng, layout, int(rng.integers(300, 500)), max_gap, labels)
    log["temperature"] = log["temperature"].round(rng.choice([1, 3, 14]))
    with tempfile.TemporaryDirectory() as folder:
        path, known, model, out = (f"{folder}/{name}" for name in ("log.csv", "corrected.csv", "model.json", "out.csv"))
        layout.dressed(log).assign(reading=log["reading"]).to_csv(path, index=False, na_rep=rng.choice(["", "NaN"]))
        if rng.random() < 0.5:
            given = ("--reading", "reading", "--quiet", "--blocks", 2, "--out", folder)
            said = run("analyze", path, *given, *options(rng, layout, max_gap, labels))
        else:
            table, fitted, said = read_table(path), random_model(rng, layout, max_gap, labels is not None), []
            fitted.set_params(effects=[effect for effect in fitted.effects if isinstance(effect, fx.Effect)])
            fitted.fit(table, table["reading"]).evaluate(table, table["reading"]).to_csv(known)
            save_model(fitted, model)
        files, saved = [path], []
        if layout.kind != "rows" and rng.random() < 0.5:  # a log that grows
            files, saved = [f"{folder}/part.csv", path], ["--state", f"{folder}/state.json"]
            lines = Path(path).read_text().splitlines(keepends=True)
            Path(files[0]).write_text("".join(lines[: rng.integers(2, len(lines))]))
        with mock.patch.object(correct, "BLOCK", int(rng.choice([8192, 37, 5]))):
            said += [text for file in files for text in run("correct", "--model", model, file, "--out", out, *saved)]
        if said:  # what has to wait for later samples is rightly refused
            return [text for text in said if "looks at samples that come later" not in text]
        got, expected = (pd.read_csv(file, dtype=str, keep_default_na=False)["corrected"] for file in (out, known))
    counts["lines of files"] += len(got)
    return [f"line {k + 2} has {a}, not {b}" for k, (a, b) in enumerate(zip(got, expected, strict=True)) if a != b][:3]


def options(rng, layout: Layout, max_gap: float | None, labels) -> list:
    time = ["--sampling-period", layout.step] if layout.kind == "rows" else ["--time", layout.keywords["time"]]
    more = [*([] if max_gap is None else ["--max-gap", max_gap]), *([] if labels is None else ["--run", "run"])]
    more += ["--time-constants", f"{5 * layout.step:g},{60 * layout.step:g}", "--degree", rng.integers(1, 4)]
    return [*time, *more, *[[], ["--products"], ["--refine"]][rng.integers(3)]]


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


def main(cases: int, seed: int, only: int | None) -> int:
    counts: Counter = Counter()
    for number in range(cases) if only is None else [only]:
        try:
            found = case(seed, number, counts)
        except Exception as error:
            if only is not None:
                raise
            found = [f"failed: {error!r}"]
        counts["cases that differ"] += bool(found)
        print("".join(f"case {number}: {text}\n" for text in found), end="", flush=True)
    print(", ".join(f"{count:,} {what}" for what, count in counts.items()))
    return int(counts["cases that differ"] > 0)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, default in {"cases": 2000, "seed": 0, "only": None}.items():
        parser.add_argument(f"--{name}", type=int, default=default)
    sys.exit(main(**vars(parser.parse_args())))
