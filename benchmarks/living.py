"""Random logs in the forms in which users hold their times, and what the whole record says of their rows."""

from typing import Any, NamedTuple, Self

import numpy as np
import pandas as pd

from thermocorr import RecordError

NS, DAY = 1_000_000_000, 86_400 * 1_000_000_000  # in nanoseconds
TICKS = {"s": NS, "ms": NS // 1000, "us": 1000, "ns": 1}
COLUMNS = ["temperature", "humidity", "pressure"]
ZONES = {"Europe/Berlin": ("2024-03-31T01", "2024-10-27T01"), "America/New_York": ("2024-03-10T07", "2024-11-03T06")}


class Layout(NamedTuple):
    """How rows carry their times."""

    kind: str
    step: float
    unit: str
    zone: str | None
    offset: float

    @classmethod
    def random(cls, rng, *kinds: str) -> Self:
        kind, step = str(rng.choice(kinds)), float(rng.choice([0.25, 1.0, 15.0, 60.0, 600.0]))
        zone = str(rng.choice(list(ZONES))) if kind == "zone" or (kind == "text" and rng.random() < 0.7) else None
        unit = str(rng.choice(["ns", "us", "ms", "s" if step >= 1 else "ms"]))
        return cls(kind, step, unit, zone, float(rng.choice([0.0, 0.1, 1e9, -12.5])))

    @property
    def keywords(self) -> dict[str, Any]:
        more = {"seconds": {"time": "s"}, "text": {"time": "stamp"}, "rows": {"sampling_period": self.step}}
        return more.get(self.kind, {})

    def with_times(self) -> Self:
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


GAP, SUSPECT = 10, 1000  # usual steps, gaps
PASSED_OVER = ("no temperature", "sentinel", "spike")
CLOSE, DIGITS = 1e-12, 1e-15  # shares of the range, and of the sum of all terms, that two ways may be apart


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
            said = got["flag"][k] in (log["fate"][k], *PASSED_OVER, *again)
            if not said or got.loc[k, ["corrected", "bias"]].notna().any():
                found.append(f"row {k} should be refused as {log['fate'][k]!r}, is {got.loc[k].to_dict()}")
            continue
        so_far = pd.concat([log[:k][sound[:k]], log[k : k + 1]])
        if len(so_far.dropna(subset=COLUMNS)):  # else there is no record
            found += [f"damaged row {k}: {text}" for text in damaged(got[k : k + 1], judge, layout, so_far)]
    return found


def damaged(got: pd.DataFrame, judge, layout: Layout, so_far: pd.DataFrame) -> list[str]:
    """Sentences on a row with a false date that differs from the last row of a record that ends with it."""
    try:
        return apart(got, whole(judge, layout, so_far))
    except RecordError as error:  # a record of one row with a sentinel is none
        alone = len(so_far) == 1 and "are refused as" in str(error)
        return [] if alone and got["flag"].iloc[0] in ("sentinel", "spike") else [str(error)]


def whole(model, layout: Layout, log: pd.DataFrame) -> pd.DataFrame:
    """`evaluate` on the whole record, its bias, the flags that a stream may give, and what rounding may cost."""
    X, U = layout.dressed(log), log["reading"].to_numpy()
    result = model.evaluate(X, U).reset_index(drop=True).assign(bias=np.asarray(model.bias(X)))
    sizes = np.abs(model.features_.transform(X)) @ np.abs(model.coef_)
    result["slack"] = DIGITS * (np.nanmax(sizes) + np.nanmax(np.abs(U), initial=0.0))
    stamps, unit = (X["s"].to_numpy(), 1) if layout.kind == "seconds" else (log["ns"].to_numpy(), NS)
    gone, flags = result["model"].isna() & result["flag"].isin(PASSED_OVER), []  # as if it had not come
    last = np.maximum.accumulate(np.r_[-1, np.where(gone, -1, np.arange(len(gone)))[:-1]])  # the row before that came
    leaps = np.where(last < 0, stamps, stamps - stamps[last]) / unit
    runs = log["run"].to_numpy() if "run" in log else np.zeros(len(log))
    first = (last < 0) | (runs != runs[last])
    for flag, step, begins, away in zip(result["flag"], leaps / gap_of(model), first, gone, strict=True):
        said = {"suspect time"} if step > SUSPECT else {flag or "gap"} if step > 1 else {flag}
        said = {flag, flag or "gap", "suspect time"} if begins else said  # how far it lies behind is not looked up
        flags.append({flag} if away else said)
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
