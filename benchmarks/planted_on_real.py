"""Known effects planted on measured records: are they named where the noise wanders, jumps and has glitches?

    python benchmarks/planted_on_real.py ../shared/records --gain 40
    python benchmarks/planted_on_real.py ../shared/records --gain 15 --kinds drift step --seeds 3

Each record keeps what nature did to it. A plant is sized by an oracle: generalised least squares, besides lags of at
most a tenth of the record, with the spectrum fitted to the record's own residual, gains `--gain` in log likelihood on
the average when the planted column is taken in. Recorded columns of other places (decoys, and one of them the culprit
where a column is planted) stand besides the temperature.

Printed for each record and together: the plant is named in either grade, or in a declared set; it is confirmed; a decoy
is confirmed; nobody is named.
"""

import itertools
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from common import asked

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import load_real_record
from thermocorr.effects import CATALOGUE, StaticPolynomial, ThermalLag
from thermocorr.effects.protocol import Effect
from thermocorr.judgement.score import Comparison
from thermocorr.model.averages import averaged
from thermocorr.records import Record, read_record
from thermocorr.records.read import Layout

KINDS = ("covariate", "lagged_covariate", "interaction", "hysteresis", "hinge", "periodic", "drift", "log_ageing",
         "sensitivity_drift", "step", "delay")  # fmt: skip
DECOYS = 4


class Planted(NamedTuple):
    """A measured record with a planted effect."""

    name: str
    X: pd.DataFrame
    y: pd.Series
    temperature: str
    label: str


def backgrounds(folder: str) -> Iterator[tuple[str, pd.Series, pd.Series]]:
    """Name, temperature and reading."""
    for run in ("run9", "run15", "run17", "run10"):
        frame = load_real_record("vhd200_resistor", folder, run=run)
        yield f"vhd200 {run}", frame["oven_temp_degC"], (frame["resistance_ohm"] / 1000 - 1) * 1e6
    for span in ("100mV", "1V"):
        frame = load_real_record("hp34420a_nanovoltmeter", folder, run=span)
        scale = frame["dut_ch1_V"].mean()
        yield f"hp34420a {span} ch1", frame["bath_temp_degC"], (frame["dut_ch1_V"] / scale - 1) * 1e6
    soil = load_real_record("oldtown_soil", folder)
    yield "oldtown 25 cm", soil["air_temp_degC"], soil["soil_temp_25cm_degC"]
    yield "oldtown 25 from 5 cm", soil["soil_temp_5cm_degC"], soil["soil_temp_25cm_degC"]
    box = load_real_record("dmm_box_heater", folder, run="log11.2")
    yield "heater", box["room_temp_degC"], box["box_temp_degC"]
    decade = load_real_record("gr1433_resistor", folder)
    yield "gr1433", decade["room_temp_degC"], (decade["resistance_ohm"] / 1e5 - 1) * 1e6


def strangers(folder: str) -> dict[str, np.ndarray]:
    """Recorded columns by the record that they come from."""
    soil = load_real_record("oldtown_soil", folder)
    meter = load_real_record("hp34420a_nanovoltmeter", folder, run="100mV")
    run = load_real_record("vhd200_resistor", folder, run="run10")
    decade = load_real_record("gr1433_resistor", folder)
    columns = {
        "oldtown/humidity": soil["air_rh_pct"], "oldtown/moisture": soil["soil_moisture_25cm_m3m3"],
        "hp34420a/pressure": meter["room_pressure_hPa"], "hp34420a/room": meter["room_temp_degC"],
        "vhd200/room": run["ambient_temp_degC"],
        "gr1433/humidity": decade["room_rh_pct"] if "room_rh_pct" in decade else decade.iloc[:, 1],
    }  # fmt: skip
    return {name: column.astype(float).interpolate().bfill().to_numpy() for name, column in columns.items()}


def stretched(column: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """A random part of a column (at least a third), as long as another record."""
    size = int(rng.uniform(0.34, 1.0) * len(column))
    start = int(rng.integers(0, len(column) - size + 1))
    return np.interp(np.linspace(0, size - 1, n), np.arange(size), column[start : start + size])


def drawn(kind: str, record: Record, names: list[str], rng: np.random.Generator) -> Effect:
    """One of the kind's candidates, moved a little off the grid."""
    found = CATALOGUE[kind].candidates(record, names)
    if kind in ("covariate", "lagged_covariate"):
        found = [effect for effect in found if effect.power == 1]
    if kind == "step":
        seconds = rng.uniform(0.15, 0.85) * record.times.between(record.stamp(record.n_used - 1), record.first_stamp())
        return CATALOGUE[kind](float(seconds))
    if kind == "periodic":  # of any period that the record holds several times
        span = max(record.duration(segment) for segment in record.segments)
        found = [CATALOGUE[kind](float(span / rng.uniform(4, 30)), 1)]
    effect = found[int(rng.integers(len(found)))]
    near = effect.nearby(record, float(rng.uniform(0.1, 0.3)))
    return near[int(rng.integers(len(near)))] if near and kind != "periodic" else effect


def planted_column(effect: Effect, record: Record, gain: float) -> np.ndarray | None:
    """The effect's column at every row, sized so that an oracle gains `gain`; None where lags hold it already."""
    span = max(record.duration(segment) for segment in record.segments)
    lags = ThermalLag(np.geomspace(0.25 * record.usual_step(), span / 10, 14).tolist())
    base = [StaticPolynomial(2), lags]
    for part in (*base, effect):
        part.learn(record)
    data = averaged(record, [*base, effect], 25_000)
    columns = data.columns[-1].sum(axis=1)[:, None]
    judged = Comparison(data.reading, np.column_stack([np.ones(len(data.reading)), *data.columns[:-1]]), data.segment)
    size = judged.smallest(columns[:, 0], gain)
    if not np.isfinite(size):
        return None
    rows, states = list[np.ndarray](), dict[int, Any]()
    for block in record.blocks():
        part, states[block.segment] = effect.columns(block, states.get(block.segment))
        rows.append(np.asarray(part).reshape(len(part), -1).sum(axis=1))
    return size * np.concatenate(rows)


@cache
def _measured(folder: str) -> tuple[dict[str, tuple[pd.Series, pd.Series]], dict[str, np.ndarray]]:
    return {name: (T, y) for name, T, y in backgrounds(folder)}, strangers(folder)


def plant(folder: str, name: str, kind: str, seed: int, gain: float) -> Planted | None:
    """One kind on one record; None where the record cannot hold it."""
    measured, foreign = _measured(folder)
    T, reading = measured[name]
    rng = np.random.default_rng([seed, list(measured).index(name), KINDS.index(kind)])
    allowed = [key for key in foreign if not name.startswith(key.split("/")[0])]
    X = T.to_frame()
    for i in rng.permutation(len(allowed))[:DECOYS]:
        X[allowed[i].replace("/", " ")] = stretched(foreign[allowed[i]], len(X), rng)
    known = T.notna() & reading.notna()
    X, y = X[known], reading[known]
    record = read_record(X, Layout(temperature=T.name), y=y.to_numpy(float), needed=list(X.columns))
    names = [column for column in X.columns if column != T.name]
    if kind != "periodic" and not CATALOGUE[kind].candidates(record, names):
        return None
    effect = drawn(kind, record, names, rng)
    column = planted_column(effect, record, gain)
    return None if column is None else Planted(name, X, y + column, str(T.name), name_of(effect))


def judged(case: Planted) -> dict[str, Any]:
    """What the diagnosis makes of a planted effect."""
    model = DynamicBiasRegressor(case.temperature).fit(case.X, case.y)
    found = diagnose(model, case.X, case.y)
    named = (*found.causes, *found.small)
    sets = [name_of(effect) for cause in named for effect in (cause.effect, *cause.confusable_with)]
    confirmed = [name_of(cause.effect) for cause in found.causes]
    own = case.label.partition(":")[2]
    return {
        "record": case.name, "kind": case.label.split(":")[0], "named": case.label in sets,
        "confirmed": case.label in confirmed, "nobody": not named, "causes": confirmed, "verdict": found.verdict,
        "proven": [name_of(cause.effect) for cause in found.small],
        "foreign": any(":" in label and label.split(":")[1] != own for label in confirmed),
    }  # fmt: skip


def name_of(effect: Effect) -> str:
    """``kind`` or ``kind:column``; a step among several is a step."""
    kind = "step" if effect.kind == "several_steps" else effect.kind
    return kind + "".join(f":{name}" for name in effect.inputs())


def main() -> None:
    options = asked(__doc__, "folder", gain=40.0, kinds=list(KINDS), seeds=[7], verbose=False)
    cases = itertools.product(_measured(options.folder)[0], options.kinds, options.seeds)
    plants = (plant(options.folder, *case, options.gain) for case in cases)
    table = pd.DataFrame([judged(case) for case in plants if case is not None])
    if options.verbose:
        print(table[~table["named"]].to_string())
    figures = ["named", "confirmed", "foreign", "nobody"]
    for by in ("kind", "record"):
        print(table.groupby(by)[figures].mean().round(2).to_string())
    print(f"gain {options.gain}, {len(table)} records: " + ", ".join(f"{f} {table[f].mean():.1%}" for f in figures))


if __name__ == "__main__":
    main()
