"""Random logs, and the forms in which users hold their times."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pandas as pd

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
