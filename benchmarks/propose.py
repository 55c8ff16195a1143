"""Which measurement decides: records whose causes a diagnosis cannot distinguish, continued as proposed and otherwise.

    python benchmarks/propose.py --find 0 4000 --ties ties.json     # seeds of ambiguous records of 20 h
    python benchmarks/propose.py --ties ties.json --hours 6         # what is named after new rows, arm by arm
    python benchmarks/propose.py --calibrate 8000 8240              # later error of a first calibration

A device, its air and its columns are simulated by heat conduction for 20 h, with one effect. Where `diagnose` says
"ambiguous", the truth among the rivals, the record goes on: as proposed with every column that may be driven, as
proposed with the temperature alone, undisturbed, and with a random temperature, or for the days that are stated. Then
`diagnose`, unchanged, judges old and new rows together. An arm is right where the planted kind, with its column, is
named first, without a rival.

A first calibration of 24 h, by stairs or in room air, is judged by its error on days 4 to 8 of the room. A
device has a nonlinearity of its own, and has settled when it begins, or is off by .6 K (standard deviation).
"""

import json
import os
import warnings
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pandas as pd
from common import asked
from joblib import Parallel, delayed
from scipy import stats

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets._climate import (
    LabClimate,
    air_pressure,
    lab_temperature,
    mains_voltage,
    room_humidity,
    smooth_noise,
    supply_voltage,
)
from thermocorr.datasets._devices import make_device
from thermocorr.datasets._heat import coloured_noise, stream
from thermocorr.effects import CATALOGUE
from thermocorr.effects.stream import own_starts, walk
from thermocorr.judgement.propose import SURE, UNDISTURBED, calibration_profile, propose
from thermocorr.judgement.search import LATE_FORM
from thermocorr.records.read import Layout, read_record

STEP, OLD, MOST, NOISE = 60.0, 1200, 34 * 1440, 0.2
"""Sampling period [s]; rows of the record, and rows that can follow; noise of a reading [ppm]."""
DEVICES = ("slab", "plate", "layered", "box")
KINDS = (
    "interaction", "lagged_modulation", "hinge", "sensitivity_step", "covariate", "lagged_covariate", "lag_products",
    "hysteresis", "saturating_covariate", "quadratic_covariate", "rate", "delay",
)  # fmt: skip
OF_TIME = ("drift", "log_ageing", "initial_transient")
LIMITS = {"temperature": (18.0, 28.0), "humidity": (30.0, 60.0), "supply": (4.98, 5.02), "mains": (222.0, 238.0)}
START = pd.Timestamp("2024-03-04")


def natural(seed: int) -> pd.DataFrame:
    """Temperature and columns as they are if nobody drives them."""
    time, rng = STEP * np.arange(OLD + MOST), [stream(seed, 0, part) for part in ("temperature", "humidity")]
    air = lab_temperature(rng[0], time, 0, 0.0, LabClimate())
    columns = {
        "temperature": air,
        "humidity": room_humidity(rng[1], time, air),
        "pressure": air_pressure(stream(seed, 0, "pressure"), time),
        "supply": supply_voltage(stream(seed, 0, "supply"), time),
        "mains": mains_voltage(stream(seed, 0, "mains"), time, 0.0),
    }
    return pd.DataFrame(columns, START + pd.to_timedelta(time, unit="s"))


def noise(seed: int) -> np.ndarray:
    """White, or with a part that remembers ten minutes."""
    time = STEP * np.arange(OLD + MOST)
    white = NOISE * stream(seed, 0, "noise").standard_normal(len(time))
    slow = coloured_noise(stream(seed, 0, "coloured_noise"), time, 0.5 * NOISE, 600.0)
    return white + (slow if seed // 48 % 2 else 0.0)


class Device:
    """A simulated device in its room, with one effect."""

    def __init__(self, seed: int, of_time: bool = False):
        kinds = OF_TIME if of_time else KINDS
        self.seed, self.kind = seed, kinds[seed % len(kinds)]
        self.natural, self.noise = natural(seed), noise(seed)
        self.effect, self.weights = self._planted()

    def _planted(self) -> tuple[Any, np.ndarray]:
        """The effect, learned on the record, and its coefficients."""
        rng = np.random.default_rng([self.seed, 7])
        old = self.natural.iloc[:OLD]
        record = read_record(old, Layout("temperature"), needed=list(old), quiet=True)
        kind = CATALOGUE[self.kind]
        effects = kind.candidates(record, [name for name in old if name != "temperature"])
        effect = effects[rng.integers(len(effects))]
        effect.learn(record)
        columns = self._columns(effect, old)
        weights = rng.choice([-1.0, 1.0], columns.shape[1])
        T = old["temperature"].to_numpy()
        law = np.column_stack([np.ones(OLD), T - T.mean(), (T - T.mean()) ** 2])
        made = columns @ weights
        left = made - law @ np.linalg.lstsq(law, made)[0]
        return effect, weights * float(rng.choice([0.3, 0.6, 1.0, 2.0])) * NOISE / max(float(left.std()), 1e-12)

    @staticmethod
    def _columns(effect: Any, frame: pd.DataFrame) -> np.ndarray:
        record = read_record(frame, Layout("temperature"), needed=list(frame), quiet=True)
        return np.concatenate([part.columns.copy() for part in walk([effect], record, starts=own_starts(record))])

    @property
    def truth(self) -> tuple[str, Any]:
        """Kind and column of what is planted."""
        return law_of(self.effect)

    def record(self, new: pd.DataFrame | None = None) -> tuple[pd.DataFrame, np.ndarray]:
        """The record, continued by rows in which some columns are driven."""
        X = self.natural.iloc[: OLD + (0 if new is None else len(new))].copy()
        if new is not None:
            for name in new:
                X.iloc[OLD:, list(X).index(name)] = new[name].to_numpy()
        device = make_device(
            DEVICES[self.seed // 12 % 4], sensitivity=10.0, nonlinearity=0.0, reference_temperature=22.5
        )
        time = STEP * np.arange(len(X))
        y = device.respond(time, X["temperature"].to_numpy(), 0.0) + self._columns(self.effect, X) @ self.weights
        return X, 250.0 + y + self.noise[: len(X)]


def law_of(effect: Any) -> tuple[str, Any]:
    """Kind and column: an effect that acts late is no other law than at once."""
    at_once = {late: kind for kind, late in LATE_FORM.items()}
    return at_once.get(effect.kind, effect.kind), next(iter(effect.inputs()), None)


def judged(X: pd.DataFrame, y: np.ndarray) -> tuple[Any, Any]:
    """The model of the temperature, and its diagnosis."""
    model = DynamicBiasRegressor("temperature").fit(X, y)
    return model, diagnose(model, X, y)


def tie(seed: int, of_time: bool) -> tuple[int, str] | None:
    """The seed of an ambiguous record whose truth is among its rivals."""
    warnings.simplefilter("ignore")
    try:
        device = Device(seed, of_time)
        _, found = judged(*device.record())
    except (ValueError, IndexError):
        return None
    if found.verdict != "ambiguous":
        return None
    cause = found.causes[0]
    rivals = list(dict.fromkeys(law_of(effect) for effect in (cause.effect, *cause.confusable_with)))
    return (
        (seed, " | ".join(f"{kind}:{column}" for kind, column in rivals))
        if device.truth in rivals and len(rivals) > 1
        else None
    )


ARMS = ("any column", "temperature", "undisturbed", "random temperature")


def decided(seed: int, hours: float, of_time: bool) -> dict[str, Any]:
    """What is named after new rows, by arm, and what was stated."""
    warnings.simplefilter("ignore")
    device = Device(seed, of_time)
    X, y = device.record()
    model, found = judged(X, y)
    began = sum(os.times()[:2])
    proposal = propose(model, found, X, y, limits=LIMITS, hours=hours)
    result: dict[str, Any] = {
        "seed": seed,
        "law": device.truth[0],
        "rivals": " | ".join(proposal.rivals),
        "nested": proposal.nested,
    }
    result["seconds"] = sum(os.times()[:2]) - began
    n = round(3600 * hours / STEP)
    result["days"] = proposal.days or 0
    result["logged"] = bool(proposal.days) and named(device, pd.DataFrame(index=range(1440 * proposal.days)))
    if of_time:
        return result
    driven = proposal.table["driven"]
    temperature = proposal.table[driven.eq("temperature") | driven.isna()]
    rng = np.random.default_rng([seed, 8])
    low, high = LIMITS["temperature"]
    steps = np.repeat(rng.uniform(low, high, -(-n // 60)), 60)[:n]
    now, wandering = float(X["temperature"].iloc[-1]), []
    for wanted in steps:
        now += min(max(wanted - now, -0.1), 0.1)  # 6 K/h
        wandering.append(now)
    for arm, name in zip(ARMS, (proposal.best, temperature.index[0], UNDISTURBED, None), strict=True):
        if name is None:
            new = pd.DataFrame({"temperature": wandering})
        else:
            new = proposal.frames[name][[driven[name]] if pd.notna(driven[name]) else []]
            result[f"ratio, {arm}"], result[f"stated, {arm}"] = proposal.table.loc[name, ["ratio", "odds"]]
        result[arm] = named(device, new)
    return result


def named(device: Device, new: pd.DataFrame) -> bool:
    """True if the planted law is named first with new rows, confirmed or proven, and without a rival.

    For an initial transient, which the model has, nothing missing is right as well.
    """
    _, found = judged(*device.record(new))
    if not (found.causes or found.small):
        return device.kind == "initial_transient" and found.verdict == "nothing missing"
    first = found.suspects[0]
    return all(law_of(effect) == device.truth for effect in (first.effect, *first.confusable_with))


MARGINS = (1.0, 8.0)
"""Limits of a calibration beyond the range of use [K]."""


def calibrated(seed: int) -> dict[str, Any]:
    """Error on later days after 24 h of room air, and of stairs, by margin."""
    warnings.simplefilter("ignore")
    rng, day = np.random.default_rng([seed, 77]), 1440
    time = STEP * np.arange(8 * day)
    air = lab_temperature(stream(seed, 0, "temperature"), time, int(rng.integers(7)), 0.0, LabClimate())
    device = make_device(
        DEVICES[seed % 4], sensitivity=10.0, nonlinearity=0.003 * rng.standard_normal(), reference_temperature=22.5
    )
    truth = device.respond(time, air, 0.0)

    def error(temperature: np.ndarray, start: float) -> float:
        read = device.respond(time[:day], temperature, start) + noise(seed + len(errors))[:day]
        model = DynamicBiasRegressor("temperature").fit(_dated(temperature), read)
        return float(np.sqrt(np.mean((np.asarray(model.predict(_dated(air))) - truth)[3 * day :] ** 2)))

    errors: dict[str, Any] = {"device": DEVICES[seed % 4]}
    for state, start in (("settled", 0.0), ("not settled", 0.6 * float(rng.standard_normal()))):  # [K]
        errors[f"room air, {state}"] = error(air[:day], start)
        for margin in MARGINS:
            stairs = calibration_profile(air.min() - margin, air.max() + margin, hours=24.0, step=STEP).to_numpy()
            errors[f"{margin:g} K, {state}"] = error(stairs + 0.03 * smooth_noise(rng, time[:day], 120.0), start)
    return errors


def _dated(temperature: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame(
        {"temperature": temperature}, START + pd.to_timedelta(STEP * np.arange(len(temperature)), unit="s")
    )


def interval(right: pd.Series) -> str:
    """k of n, with the interval of Clopper and Pearson."""
    k, n = int(right.sum()), len(right)
    if not n:
        return "-"
    low, high = stats.binomtest(k, n).proportion_ci(0.95)
    return f"{k} of {n} ({100 * k / n:.0f} %, {100 * low:.0f} to {100 * high:.0f})"


def main() -> None:
    options = asked(
        __doc__, find=[0], calibrate=[0], ties="ties.json", hours=6.0, of_time=False, jobs=os.cpu_count(),
        verbose=False,
    )  # fmt: skip
    path, work = Path(options.ties), Parallel(options.jobs)
    if len(options.find) == 2:
        found = [each for each in work(delayed(tie)(seed, options.of_time) for seed in range(*options.find)) if each]
        path.write_text(json.dumps(found))
        print(
            f"{len(found)} ambiguous records of {options.find[1] - options.find[0]}, with the truth among their rivals"
        )
        return
    if len(options.calibrate) == 2:
        errors = pd.DataFrame(work(delayed(calibrated)(seed) for seed in range(*options.calibrate)))
        print(errors.groupby("device").median().T.round(3).to_string())
        for state in ("settled", "not settled"):
            for arm in (f"{margin:g} K, {state}" for margin in MARGINS):
                better = errors[arm] < errors[f"room air, {state}"]
                some = {name: f"{own.mean():.2f}" for name, own in better.groupby(errors["device"])}
                print(f"limits beyond the range of use by {arm}: better than room air {interval(better)}, {some}")
        return
    seeds = [seed for seed, _ in json.loads(path.read_text())]
    table = pd.DataFrame(work(delayed(decided)(seed, options.hours, options.of_time) for seed in seeds))
    if options.verbose:
        print(table.to_string())
    print(f"processor time {table['seconds'].median():.2f} s median, {table['seconds'].max():.2f} at most")
    table = table[~table["nested"]]
    stated = table[table["days"] > 0]
    print(
        f"days stated {stated['days'].value_counts().to_dict()}, named rightly after them {interval(stated['logged'])}"
    )
    if options.of_time:
        return
    for arm in ARMS:
        print(f"{arm:20s} named rightly {interval(table[arm])}")
    for arm in ARMS[:3]:
        ratio, stated = table[f"ratio, {arm}"], table[f"stated, {arm}"]
        for low, high in ((SURE, np.inf), (8.0, SURE), (4.0, 8.0), (0.0, 4.0)):
            some = table[(ratio >= low) & (ratio < high)]
            said = "nothing" if high == 4.0 else f"{100 * stated[some.index].mean():.0f} %" if len(some) else "-"
            print(f"{arm:20s} ratio {low:g} to {high:g}: stated {said}, kept {interval(some[arm])}")
    better, worse = (int((table[one] & ~table[other]).sum()) for one, other in (ARMS[::2], ARMS[2::-2]))
    print(f"proposed against undisturbed: {better} better, {worse} worse")


if __name__ == "__main__":
    main()
