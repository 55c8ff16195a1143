"""What it costs, as ratios within one process: the page docs/performance.md, and a check that nothing became slow.

    python benchmarks/performance.py                    # prints the table: some minutes
    python benchmarks/performance.py --write            # and writes docs/performance.md and benchmarks/ratios.json
    python benchmarks/performance.py --check            # quick lines alone, against ratios.json: exit status 1 beyond

Each line is our processor time over that of something that a user could do instead, or that bounds it from below: the
least of alternated runs, one BLAS thread. Times differ from machine to machine, most ratios hardly: a line fails the
check where it is more than 1.5 times what ratios.json says of such a processor (of any, the greatest, where this one is
new), in three tries. What is stored only falls, lest a noisy run loosens the check: take a line out of ratios.json by
hand where it has to grow.
"""

import io
import json
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import pandas as pd
from common import asked
from scipy.linalg.blas import dsyrk
from scipy.signal import lfilter
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.linear_model import Ridge
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit
from sklearn.pipeline import make_pipeline
from threadpoolctl import threadpool_info, threadpool_limits

from thermocorr import DynamicBiasRegressor, OnlineCorrector, TimeConstantSearch, diagnose, read_log
from thermocorr.effects import ThermalLag

ROOT = Path(__file__).parents[1]
PAGE, STORED = ROOT / "docs" / "performance.md", ROOT / "benchmarks" / "ratios.json"
TAUS = (60.0, 240.0, 900.0, 3600.0, 14_400.0, 43_200.0)
STEP = 15.0
LFILTER = "lfilter and Ridge(cholesky)"
WORSE = 1.5
TRIES = 3

Run = Callable[[], object]


class Line(NamedTuple):
    """One comparison."""

    what: str
    against: str
    ours: Run
    other: Run
    repeats: int = 7
    scale: float = 1.0  # runs of ours that one run of the other stands for


class Lags(TransformerMixin, BaseEstimator):
    """What a user would write: lags by scipy's lfilter, regular steps, and the decays of a start, where it was none."""

    def __init__(self, time_constants: tuple[float, ...] = TAUS, decays: bool = False):
        self.time_constants = time_constants
        self.decays = decays

    def fit(self, X: np.ndarray, y: object = None) -> Self:
        return self

    def transform(self, X: np.ndarray) -> np.ndarray:
        T = X[:, 0]
        keep = [np.exp(-STEP / tau) for tau in self.time_constants]
        columns = [T, *(lfilter([1 - a], [1, -a], T, zi=[a * T[0]])[0] - T for a in keep)]
        rows = np.arange(len(T))
        return np.column_stack([*columns, *(a**rows for a in keep)] if self.decays else columns)


def record(n: int, jitter: float = 0.0) -> tuple[pd.DataFrame, pd.Series]:
    """A room with two swings and a random walk."""
    rng = np.random.default_rng(0)
    seconds = STEP * np.arange(n) + jitter * STEP * rng.uniform(-0.5, 0.5, n)
    T = 23 + np.sin(seconds / 7000) + 0.3 * np.sin(seconds / 900) + 0.003 * np.cumsum(rng.normal(size=n))
    frame = pd.DataFrame({"temperature": T}, index=pd.to_timedelta(seconds, unit="s"))
    return frame, pd.Series(10 * T + 0.2 * rng.normal(size=n), index=frame.index)


def by_hand(X: pd.DataFrame, y: pd.Series) -> None:
    """Own lags and decays as one matrix, then Ridge."""
    T = X.to_numpy()
    seconds = STEP * np.arange(len(T))
    decays = [np.exp(-seconds / tau) for tau in TAUS]
    Ridge(alpha=1e-10, solver="cholesky").fit(np.column_stack([Lags().transform(T), *decays]), y)


READY = np.asfortranarray(np.random.default_rng(1).normal(size=(8192, 15)))


def floor(X: pd.DataFrame) -> None:
    """One read, and the cross products of ready blocks of 15 columns: the least that least squares could do."""
    X["temperature"].to_numpy().sum()
    for _ in range(-(-len(X) // len(READY))):
        dsyrk(1.0, READY, trans=1)


def in_rows(n: int) -> str:
    """A number of rows with blanks between thousands."""
    return f"{n:,} rows".replace(",", " ")


def fits(n: int) -> list[Line]:
    """Fits of n rows."""
    X, y = record(n)
    uneven, y_uneven = record(n, jitter=0.5)
    model = DynamicBiasRegressor(time_constants=TAUS, degree=1)
    repeats = 15 if n < 500_000 else 5
    rows, ours, irregular = in_rows(n), partial(model.fit, X, y), partial(model.fit, uneven, y_uneven)
    return [
        Line(f"fit of 6 time constants, {rows}", LFILTER, ours, partial(by_hand, X, y), repeats),
        Line(f"fit, {rows}", "ready cross products (floor)", ours, partial(floor, X), repeats),
        Line(f"fit of irregular steps, {rows}", "of regular ones", irregular, ours, repeats),
    ]


def segments() -> list[Line]:
    """300 runs in place of one."""
    X, y = record(84_000)
    runs = X.assign(run=np.arange(len(X)) * 300 // len(X))
    many = DynamicBiasRegressor("temperature", TAUS[:4], run="run")
    rest = DynamicBiasRegressor("temperature", [], run="run", effects=[ThermalLag(TAUS[:4])])
    what, fitted = "300 runs with start-up decays, 84 000 rows", partial(many.fit, runs, y)
    return [
        Line(f"fit of {what}", "without the decays", fitted, partial(rest.fit, runs, y), 5),
        Line(f"predict of {what}", "its fit", partial(many.predict, runs), fitted, 5),
    ]


def searches(n: int, sets: int) -> Line:
    """1000 sets of 6 time constants in 5 folds; scikit-learn's share is timed over some of them."""
    X, y = record(n)
    pool = np.geomspace(30.0, n * STEP / 3, 24)
    rng = np.random.default_rng(0)
    chosen = [tuple(np.sort(rng.choice(pool, 6, replace=False))) for _ in range(1000)]
    search = TimeConstantSearch(
        DynamicBiasRegressor(degree=1), chosen, alphas=[1e-6], cv=TimeSeriesSplit(5),
        refit=False,
    )  # fmt: skip
    grid = GridSearchCV(
        make_pipeline(Lags(decays=True), Ridge(1e-6, solver="cholesky")), {"lags__time_constants": chosen[:sets]},
        cv=TimeSeriesSplit(5), scoring="neg_root_mean_squared_error", refit=False,
    )  # fmt: skip
    what, against = f"search of 1000 sets in 5 folds, {in_rows(n)}", f"GridSearchCV of {LFILTER}"
    ours, other = partial(search.fit, X, y), partial(grid.fit, X.to_numpy(), y)
    return Line(what, against, ours, other, 7 if n < 500_000 else 3, 1000 / sets)


def others() -> list[Line]:
    """Forecasts, live correction, diagnosis, files."""
    X, y = record(84_000)
    model = DynamicBiasRegressor("temperature", TAUS).fit(X, y)
    searched = DynamicBiasRegressor("temperature").fit(X, y)
    live = OnlineCorrector(model)
    times, T, U = X.index[:5000].tolist(), X["temperature"].tolist()[:5000], y.tolist()[:5000]

    def one_by_one() -> None:
        live.reset()
        for row in zip(times, T, U, strict=True):
            live.update(*row)

    def together() -> None:  # ten times: a millisecond alone is no measure
        for _ in range(10):
            live.reset()
            live.update_many(X[:5000], y[:5000])

    def in_hundreds() -> None:
        live.reset()
        for start in range(0, 5000, 100):
            live.update_many(X[start : start + 100], y[start : start + 100])

    def pandas() -> object:
        return pd.read_csv(io.BytesIO(content), parse_dates=["time"])

    def told() -> object:
        form = "%d.%m.%Y %H:%M:%S"
        return pd.read_csv(german, sep=";", decimal=",", parse_dates=["time"], date_format=form)

    plain, german = (Path(tempfile.mkdtemp()) / "log.csv" for _ in range(2))
    table = pd.DataFrame(
        {
            "time": pd.date_range("2024-03-04", periods=300_000, freq="15s"),
            "temperature": 23.456 + np.arange(300_000) % 97 / 7,
        }
    )
    table["reading"] = 10 * table["temperature"]
    table.to_csv(plain, index=False)
    table.to_csv(german, index=False, sep=";", decimal=",", date_format="%d.%m.%Y %H:%M:%S")
    content = plain.read_bytes()
    given, chosen, predicted = partial(model.fit, X, y), partial(searched.fit, X, y), partial(model.predict, X)
    return [
        Line("predict, 84 000 rows", "its fit", predicted, given),
        Line("evaluate (corrected, model, residual, flags)", "predict", partial(model.evaluate, X, y), predicted),
        Line("live, 5000 samples one by one", "in one block", one_by_one, together, 5, scale=0.1),
        Line("live, 5000 samples in blocks of 100", "one by one", in_hundreds, one_by_one, 5),
        Line("search and fit (defaults), 84 000 rows", "fit of 6 given", chosen, given),
        Line("diagnose, nothing missing, 84 000 rows", "search and fit", partial(diagnose, searched, X, y), chosen, 3),
        Line("uncertainties of all rows", "search and fit", partial(uncertain, searched, X, y), chosen, 3),
        Line("read plain CSV with dates, 300 000 rows", "pandas.read_csv", partial(read_log, plain), pandas, 3),
        Line("read semicolons, decimal commas and dates", "pandas, told how", partial(read_log, german), told, 3),
    ]


def uncertain(model: DynamicBiasRegressor, X: pd.DataFrame, y: pd.Series) -> object:
    """The joint errors anew, and what they say of every row."""
    model.__dict__.pop("_known_errors", None)
    return model.correct(X, y, return_std=True)


def lines(check: bool) -> list[Line]:
    """All comparisons, or the quick ones."""
    quick = [*fits(84_000), *segments(), searches(84_000, 10), *others()]
    return quick if check else [*quick, *fits(1_000_000), searches(1_000_000, 4), long_csv()]


def long_csv(n: int = 3_000_000) -> Line:
    """A long log with dates, read by us and by pyarrow in one thread."""
    from pyarrow import csv

    path, rng = Path(tempfile.mkdtemp()) / "log.csv", np.random.default_rng(0)
    dates = pd.date_range("2024-03-04", periods=n, freq="1s")
    values = {"temperature": 23 + 1e-3 * np.cumsum(rng.standard_normal(n)), "reading": rng.standard_normal(n)}
    pd.DataFrame({"time": dates, **values}).to_csv(path, index=False)

    def ours() -> object:
        return read_log(path)

    def other() -> object:
        return csv.read_csv(path, read_options=csv.ReadOptions(use_threads=False)).to_pandas()

    return Line("read CSV and its dates, 3 000 000 rows", "pyarrow, one thread", ours, other, 3)


def ratio(line: Line) -> float:
    """Least processor time of ours over that of the other, alternated."""
    ours, other = [], []
    for _ in range(line.repeats):
        for run, spent in ((line.ours, ours), (line.other, other)):
            began = time.process_time()
            run()
            spent.append(time.process_time() - began)
    return min(ours) / (min(other) * line.scale)


def key(line: Line) -> str:
    """Name of a line in the stored ratios."""
    return f"{line.what} / {line.against}"


def processor() -> str:
    """Kind of processor, as BLAS knows it: some differ in what Python costs besides cross products by a half."""
    return next((str(library["architecture"]) for library in threadpool_info() if "architecture" in library), "unknown")


def stored_ratio(stored: dict[str, dict[str, float]], name: str) -> float:
    """What a line was at best on such a processor; the greatest of others where there is none."""
    known = {kind: ratios[name] for kind, ratios in stored.items() if name in ratios}
    if not known:
        raise SystemExit(f"ratios.json knows nothing of {name!r}: python benchmarks/performance.py --write stores it.")
    return known.get(processor(), max(known.values()))


def shown(value: float) -> str:
    """A ratio, or its inverse where that reads better."""
    return f"{value:.2f}" if value >= 0.1 else f"1/{1 / value:.0f}"


_PAGE = """# What it costs

Ratios of processor times within one process (the least of alternated runs, one BLAS thread), made by
`python benchmarks/performance.py --write`, which also stores them for the check that runs before every change, by the
kind of processor: some differ in what Python costs besides cross products by a half.

{table}

On {machine}; {versions}; fits {compiled}.

"Floor" is one read of the temperature and the cross products of ready blocks of as many columns: no least squares could
do with less. scikit-learn's search is timed over some of the 1000 sets, with a transformer that does nothing but
`lfilter`. Memory: a fit needs a few MiB beyond the data whatever their length
(`benchmarks/streaming.py`).
"""


def page(found: dict[str, tuple[Line, float]]) -> str:
    """The page of the documentation."""
    rows = [f"| {line.what} | {line.against} | {shown(value)} |" for line, value in found.values()]
    packages = ("numpy", "scipy", "scikit-learn", "pandas", *(["numba"] if find_spec("numba") else []))
    return _PAGE.format(
        table="\n".join(["| what | over | ratio |", "|---|---|---|", *rows]),
        machine=f"{platform.machine()} ({processor()}), {os.cpu_count()} cores, Python {platform.python_version()}",
        versions=", ".join(f"{name} {version(name)}" for name in packages),
        compiled="compiled by numba" if find_spec("numba") else "not compiled",
    )


def checked(found: Line, stored: float) -> float:
    """The best ratio of some tries, until it is good enough."""
    best = np.inf
    for _ in range(TRIES):
        best = min(best, ratio(found))
        if best <= WORSE * stored:
            break
    return float(best)


def main() -> int:
    options = asked(__doc__, write=False, check=False)
    stored = json.loads(STORED.read_text())
    found: dict[str, tuple[Line, float]] = {}
    slow = []
    with threadpool_limits(1):
        for line in lines(options.check):
            line.ours()
            before = stored_ratio(stored, key(line)) if options.check else np.inf
            value = checked(line, before) if options.check else ratio(line)
            found[key(line)] = (line, value)
            worse = value > WORSE * before
            slow += [line.what] * worse
            was = f"   (stored {shown(before)}{', SLOWER' if worse else ''})" if options.check else ""
            print(f"{line.what:52s} over {line.against:44s} {shown(value):>8s}{was}", flush=True)
    if options.write:
        PAGE.write_text(page(found), encoding="utf-8")
        own = stored.get(processor(), {})
        own = {name: round(min(value, own.get(name, value)), 5) for name, (_, value) in found.items()}
        STORED.write_text(json.dumps({**stored, processor(): own}, indent=1) + "\n")
    return 1 if slow else 0


if __name__ == "__main__":
    sys.exit(main())
