"""What a user could pick instead: the same simulated devices, learned and run free by other tools, in one table.

    python benchmarks/peers.py                                  # three records of each device, 84 000 rows
    python benchmarks/peers.py --rows 12000 --seeds 1           # does everything run?
    python benchmarks/peers.py --tools static defaults pastas   # some of the tools
    python benchmarks/peers.py --device layered                 # a device with two distant time constants

Every tool learns on the first 70 % of the rows; on the rest it gets the temperature alone, never a reading, and its
lags go on from the learned part. The residual is the rms over the rest, offset included, over the standard deviation
of the white noise; "noise alone" is what the record's own noise leaves. Processor times and residuals are medians over
the records of a linear device and one that is nonlinear by 0.1 / K. Each tool runs once on a short record before, so
that imports and compilation do not count.

Tools: pip install pastas tqdm sysidentpy. What is missing is listed as not installed.
"""

import contextlib
import logging
import time
import warnings
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from common import asked, rms
from scipy.optimize import least_squares
from scipy.signal import lfilter
from sklearn.base import BaseEstimator
from sklearn.linear_model import Ridge
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler
from threadpoolctl import threadpool_limits

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor
from thermocorr.datasets import make_record

STEP = 15.0  # [s]

Array = np.ndarray
Forecast = Callable[[Array, Array], Array]  # times [s] and temperatures of the rows that follow -> readings
Fit = Callable[[Array, Array, Array], Forecast]  # times [s], temperatures, readings of the learned rows


# ---- what several tools share ----------------------------------------------------------------------------------------
def frame(t: Array, T: Array) -> pd.DataFrame:
    """Temperature with its times."""
    return pd.DataFrame({"temperature": T}, index=pd.to_timedelta(t, unit="s"))


def candidate_sets(t: Array) -> list[tuple[float, ...]]:
    """Fifty sets of six of 24 time constants [s] between two steps and a third of the record, drawn once."""
    pool = np.geomspace(30.0, t[-1] / 3, 24)
    every = list(combinations(range(24), 6))
    chosen = np.random.default_rng(0).choice(len(every), 50, replace=False)
    return [tuple(pool[list(every[i])]) for i in chosen]


def lags(T: Array, time_constants: Any) -> Array:
    """First-order lags of T by scipy, at rest at the start; one column per time constant [s]."""
    keep = np.exp(-STEP / np.asarray(time_constants))
    return np.stack([lfilter([1 - a], [1, -a], T, zi=[a * T[0]])[0] for a in keep], axis=1)


def means(values: Array, rows: int) -> Array:
    """Means of blocks of that many rows."""
    return values.reshape(-1, rows).mean(axis=1)


def between(t: Array, blocks: Array, rows: int) -> Array:
    """Block means back to the rows, linearly."""
    return np.interp(t, means(t, rows), blocks)


# ---- tools -----------------------------------------------------------------------------------------------------------
def static_quadratic(t: Array, T: Array, y: Array) -> Forecast:
    """numpy.polyfit of degree 2: no memory at all."""
    law = np.polyfit(T - T.mean(), y, 2)
    return lambda t_new, T_new: np.polyval(law, T_new - T.mean())


def forecasting(model: BaseEstimator, t: Array, T: Array, y: Array) -> Forecast:
    """A model with the interface of scikit-learn, fitted."""
    model.fit(frame(t, T), y)
    return lambda t_new, T_new: model.predict(frame(t_new, T_new))


def grid_search(t: Array, T: Array, y: Array) -> Forecast:
    """GridSearchCV over fifty sets: DiffusiveFeatures (degree 2), StandardScaler, Ridge(1e-3), TimeSeriesSplit(5)."""
    steps = [("lags", DiffusiveFeatures(degree=2)), ("scale", StandardScaler()), ("ridge", Ridge(1e-3))]
    return _grid_search(Pipeline(steps), t, T, y)


def grid_search_squares(t: Array, T: Array, y: Array) -> Forecast:
    """The same with PolynomialFeatures(2) of temperature and lags: every square and every product."""
    features = DiffusiveFeatures(degree=1, initial_state="equilibrium")  # squares of start-up decays make no sense
    squares = make_pipeline(StandardScaler(), PolynomialFeatures(2, include_bias=False), StandardScaler())
    return _grid_search(Pipeline([("lags", features), ("squares", squares), ("ridge", Ridge(1e-3))]), t, T, y)


def _grid_search(pipeline: Pipeline, t: Array, T: Array, y: Array) -> Forecast:
    grid = {"lags__time_constants": candidate_sets(t)}
    model = GridSearchCV(pipeline, grid, cv=TimeSeriesSplit(5), scoring="neg_root_mean_squared_error")
    return forecasting(model, t, T, y)


def variable_projection(t: Array, T: Array, y: Array) -> Forecast:
    """scipy's least_squares on the logarithms of three time constants; coefficients by lstsq inside."""

    def design(T_all: Array, logs: Array) -> Array:
        excess = T_all - T.mean()
        return np.column_stack([np.ones_like(excess), excess, excess**2, lags(excess, np.exp(logs))])

    def residual(logs: Array) -> Array:
        Q = design(T, logs)
        return y - Q @ np.linalg.lstsq(Q, y, rcond=None)[0]

    bounds = np.log([STEP, STEP * len(T) / 3])
    logs = least_squares(residual, np.log([300.0, 3e3, 3e4]), bounds=bounds, diff_step=1e-4).x
    coefficients = np.linalg.lstsq(design(T, logs), y, rcond=None)[0]
    return lambda t_new, T_new: design(np.append(T, T_new), logs)[len(T) :] @ coefficients


def pastas(t: Array, T: Array, y: Array) -> Forecast:
    """Pastas at 2 min (8 rows): T and its square as stresses, a double exponential each; no noise model.

    Its time unit is the day, and its starting values are tens of days: they are set to minutes and hours. Before the
    record the stresses are those of its first row; a day of warm-up.
    """
    import pastas as ps

    ps.set_log_level("ERROR")
    day = 86_400.0

    def series(t_all: Array, values: Array) -> pd.Series:
        stamps = pd.Timestamp("2024-01-01") + pd.to_timedelta(means(t_all, 8) - means(t[:8], 8), unit="s")
        return pd.Series(means(values, 8), stamps)

    def build(t_all: Array, T_all: Array) -> Any:
        model = ps.Model(series(t, y - y.mean()), name="reading", freq="2min")
        for name, power in (("T", 1), ("T2", 2)):
            stress = series(t_all, (T_all - T.mean()) ** power)
            settings = {
                "fill_before": "bfill",
                "fill_after": "ffill",
                "sample_up": "interpolate",
                "sample_down": "mean",
            }
            ps.StressModel(model, stress, ps.DoubleExponential(), name=name, up=None, settings=settings)
            model.set_parameter(f"{name}_a1", initial=600 / day, pmin=30 / day, pmax=1.0)
            model.set_parameter(f"{name}_a2", initial=3600 / day, pmin=60 / day, pmax=5.0)
        return model

    learned = build(t, T)
    learned.solve(report=False, warmup=1)
    values = learned.parameters["optimal"].to_numpy()

    def forecast(t_new: Array, T_new: Array) -> Array:
        model = build(np.append(t, t_new), np.append(T, T_new))
        end = series(np.append(t, t_new), np.append(T, T_new)).index[-1]
        simulated = model.simulate(p=values, tmax=end, warmup=1)
        return y.mean() + between(t_new, simulated.to_numpy()[-len(t_new) // 8 :], 8)

    return forecast


def frols_narx(t: Array, T: Array, y: Array) -> Forecast:
    """SysIdentPy's FROLS, NARX of degree 2 on means of 8 rows (2 min): four lags each, the best 20 terms."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    u, v = means(T - T.mean(), 8)[:, None], means(y - y.mean(), 8)[:, None]
    model = FROLS(
        ylag=[1, 2, 3, 4], xlag=[1, 2, 3, 4], n_terms=20, basis_function=Polynomial(degree=2), elag=1,
        estimator=LeastSquares(), order_selection=False,
    )  # fmt: skip
    model.fit(X=u[1:], y=v[:-1])  # its lags begin at 1: one step ahead, so that T of the same block takes part
    known = model.max_lag

    def forecast(t_new: Array, T_new: Array) -> Array:
        later = np.append(u[1 - known :], means(T_new - T.mean(), 8)[:, None], axis=0)
        later = np.append(later, later[-1:], axis=0)  # lag 0 is not used: any value
        simulated = model.predict(X=later, y=v[-known:])[known:, 0]
        return y.mean() + between(t_new, simulated, 8)

    return forecast


TOOLS: dict[str, tuple[str, Fit]] = {
    "static": ("static quadratic (numpy.polyfit)", static_quadratic),
    "defaults": ("thermocorr, defaults", partial(forecasting, DynamicBiasRegressor())),
    "products": ("thermocorr, products=True", partial(forecasting, DynamicBiasRegressor(products=True))),
    "grid": ("GridSearchCV, 50 sets", grid_search),
    "grid2": ("GridSearchCV, 50 sets, all products", grid_search_squares),
    "varpro": ("scipy least_squares, 3 lags", variable_projection),
    "pastas": ("Pastas, double exponentials, 2 min", pastas),
    "narx": ("SysIdentPy FROLS NARX, 2 min", frols_narx),
}


# ---- the table -------------------------------------------------------------------------------------------------------
NOISE = 0.2  # [ppm]
SHARE = 0.7  # learned
BLOCK = 40  # rows; the lengths are multiples of it, so that block means need no care
DEVICES = {"linear": 0.0, "nonlinear": 0.1}  # [1/K]
PACKAGES = ("thermocorr", "numpy", "scipy", "pastas", "sysidentpy", "numba")


class Log(NamedTuple):
    """Times [s], temperature, reading and noise; the first rows are learned."""

    t: Array
    T: Array
    y: Array
    noise: Array

    @property
    def learned(self) -> int:
        return round(SHARE * len(self.t)) // BLOCK * BLOCK


def made(rows: int, device: str, nonlinearity: float, seed: int) -> Log:
    """One simulated record."""
    rows = rows // BLOCK * BLOCK
    record, truth = make_record(
        rows, sampling_period=STEP, device=device, noise=NOISE, nonlinearity=nonlinearity, seed=seed, return_truth=True
    )
    columns = (record["temperature"], record["reading"], truth["noise"])
    return Log(STEP * np.arange(rows), *(column.to_numpy() for column in columns))


def tried(fit: Fit, log: Log) -> tuple[float, float, float]:
    """Processor time of the fit and of the forecast [s], and the residual over the noise."""
    n, began = log.learned, time.process_time()
    forecast = fit(log.t[:n], log.T[:n], log.y[:n])
    fitted = time.process_time()
    expected = np.asarray(forecast(log.t[n:], log.T[n:]))
    return fitted - began, time.process_time() - fitted, rms(log.y[n:] - expected) / NOISE


def line(fit: Fit, short: Log, records: dict[str, list[Log]]) -> str:
    """Figures of a tool, or why there are none."""
    with contextlib.suppress(ValueError, ArithmeticError, np.linalg.LinAlgError):  # it may be too short for a tool
        tried(fit, short)
    found = np.array([[tried(fit, log) for log in logs] for logs in records.values()])  # device, record, figure
    fitted, forecast = np.median(found[:, :, :2], axis=(0, 1))
    residuals = np.median(found[:, :, 2], axis=1)
    return f"{fitted:8.3f} {forecast:10.3f} " + " ".join(f"{value:10.3f}" for value in residuals)


def main() -> None:
    options = asked(__doc__, rows=84_000, device="slab", seeds=[1, 2, 3], tools=list(TOOLS))
    warnings.simplefilter("ignore")
    logging.disable(logging.WARNING)
    with threadpool_limits(1):
        records = {
            name: [made(options.rows, options.device, value, seed) for seed in options.seeds]
            for name, value in DEVICES.items()
        }
        short = made(4000, options.device, DEVICES["nonlinear"], 0)
        versions = ", ".join(f"{name} {version(name)}" for name in PACKAGES if find_spec(name))
        print(f"one BLAS thread; {versions}\n{options.device}, {options.rows} rows, seeds {options.seeds}")
        print(f"{'tool':42s} {'fit/s':>8s} {'forecast/s':>10s} " + " ".join(f"{name:>10s}" for name in records))
        floor = [np.median([rms(log.noise[log.learned :]) / NOISE for log in logs]) for logs in records.values()]
        print(f"{'noise alone':42s} {'':19s} " + " ".join(f"{value:10.3f}" for value in floor))
        for name in options.tools:
            what, fit = TOOLS[name]
            try:
                said = line(fit, short, records)
            except ImportError as error:
                said = f"not installed ({error.name})"
            except Exception as error:
                said = f"{type(error).__name__}: {str(error)[:100]}"
            print(f"{what:42s} {said}", flush=True)


if __name__ == "__main__":
    main()
