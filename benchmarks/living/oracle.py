"""What the whole record says of the rows of a stream, and where a stream differs from it."""

from __future__ import annotations

import numpy as np
import pandas as pd

from thermocorr import RecordError

from .logs import COLUMNS, NS, Layout

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
