"""What a user could pick instead: the same simulated devices, learned and run free by other tools, in one table.

    python benchmarks/peers.py                                  # three records of each device, 84 000 rows
    python benchmarks/peers.py --quick                          # 12 000 rows, one record: does everything run?
    python benchmarks/peers.py --tools static,defaults,pastas   # some of the tools
    python benchmarks/peers.py --device layered                 # a device with two distant time constants

Every tool learns on the first 70 % of the rows; on the rest it gets the temperature alone, never a reading, and its
lags go on from the learned part. The residual is the rms over the rest, offset included, over the standard deviation
of the white noise; "noise alone" is what the record's own noise leaves. Fit and forecast times and residuals are
medians over the records; the memory is the peak of what tracemalloc sees (numpy included) in a separate fit of one
record. Each tool runs once on a short record before, so that imports and compilation do not count.

Tools: pip install statsmodels pastas tqdm pysindy sysidentpy. What is missing is listed as not installed.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import logging
import platform
import time
import tracemalloc
import warnings
from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import least_squares
from scipy.signal import lfilter
from sklearn.linear_model import Ridge
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler
from threadpoolctl import threadpool_limits

import thermocorr
from thermocorr import DiffusiveFeatures, DynamicBiasRegressor, TimeConstantSearch
from thermocorr.datasets import make_record
from thermocorr.effects import LagProducts

NOISE = 0.2  # [ppm]
STEP = 15.0  # [s]
SHARE = 0.7  # learned
BLOCK = 40  # rows; the lengths are multiples of it, so that block means need no care
PACKAGES = ("numpy", "scipy", "scikit-learn", "statsmodels", "pastas", "pysindy", "sysidentpy", "numba")

Array = np.ndarray
Forecast = Callable[[Array, Array], Array]  # times [s] and temperatures of the rows that follow -> readings
Fit = Callable[[Array, Array, Array], Forecast]  # times [s], temperatures, readings of the learned rows


# What several tools share


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


# Tools


def static_quadratic(t: Array, T: Array, y: Array) -> Forecast:
    """numpy.polyfit of degree 2: no memory at all."""
    law = np.polyfit(T - T.mean(), y, 2)
    return lambda t_new, T_new: np.polyval(law, T_new - T.mean())


def defaults(t: Array, T: Array, y: Array) -> Forecast:
    """DynamicBiasRegressor as it comes: static quadratic, lags chosen by itself."""
    model = DynamicBiasRegressor().fit(frame(t, T), y)
    return lambda t_new, T_new: model.predict(frame(t_new, T_new))


def products(t: Array, T: Array, y: Array) -> Forecast:
    """DynamicBiasRegressor(products=True): the same choice of lags, and the products Psi_j Psi_k."""
    model = DynamicBiasRegressor(products=True).fit(frame(t, T), y)
    return lambda t_new, T_new: model.predict(frame(t_new, T_new))


def search(t: Array, T: Array, y: Array) -> Forecast:
    """TimeConstantSearch by cross-validation over the fifty sets that GridSearchCV gets."""
    model = TimeConstantSearch(candidates=candidate_sets(t), method="cross_validation").fit(frame(t, T), y)
    return lambda t_new, T_new: model.predict(frame(t_new, T_new))


def search_all_products(t: Array, T: Array, y: Array) -> Forecast:
    """TimeConstantSearch by cross-validation over its own pool, then Psi_j Psi_k and (T - T0) Psi_j of these lags."""
    found = TimeConstantSearch(method="cross_validation", refit=False).fit(frame(t, T), y)
    taus = found.best_params_["time_constants"]
    effects = [LagProducts(taus, temperature_products=True)]
    model = DynamicBiasRegressor(time_constants=taus, effects=effects).fit(frame(t, T), y)
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
    model.fit(frame(t, T), y)
    return lambda t_new, T_new: model.predict(frame(t_new, T_new))


def ols(t: Array, T: Array, y: Array) -> Forecast:
    """statsmodels OLS of T, its square and lags, refitted for each of the fifty sets; the least AIC wins."""
    import statsmodels.api as sm

    def design(T_all: Array, taus: tuple[float, ...]) -> Array:
        excess = T_all - T.mean()
        return np.column_stack([np.ones_like(excess), excess, excess**2, lags(excess, taus)])

    sets = candidate_sets(t)
    best = min(range(len(sets)), key=lambda i: sm.OLS(y, design(T, sets[i])).fit().aic)
    model = sm.OLS(y, design(T, sets[best])).fit()
    return lambda t_new, T_new: model.predict(design(np.append(T, T_new), sets[best])[len(T) :])


def variable_projection(t: Array, T: Array, y: Array) -> Forecast:
    """scipy's least_squares on the logarithms of three time constants; coefficients by lstsq inside."""
    return _variable_projection([300.0, 3e3, 3e4], lambda excess, late: np.column_stack([excess**2, late]), T, y)


def variable_projection_squares(t: Array, T: Array, y: Array) -> Forecast:
    """The same with two time constants and every square and product of temperature and lags."""

    def columns(excess: Array, late: Array) -> Array:
        return PolynomialFeatures(2, include_bias=False).fit_transform(np.column_stack([excess, late]))[:, 1:]

    return _variable_projection([300.0, 3e3], columns, T, y)


def _variable_projection(start: list[float], columns: Callable[..., Array], T: Array, y: Array) -> Forecast:
    def design(T_all: Array, logs: Array) -> Array:
        excess = T_all - T.mean()
        return np.column_stack([np.ones_like(excess), excess, columns(excess, lags(excess, np.exp(logs)))])

    def residual(logs: Array) -> Array:
        Q = design(T, logs)
        return y - Q @ np.linalg.lstsq(Q, y, rcond=None)[0]

    longest = STEP * len(T) / 3
    logs = least_squares(residual, np.log(start), bounds=np.log([STEP, longest]), diff_step=1e-4).x
    coefficients = np.linalg.lstsq(design(T, logs), y, rcond=None)[0]
    return lambda t_new, T_new: design(np.append(T, T_new), logs)[len(T) :] @ coefficients


def ardl(t: Array, T: Array, y: Array) -> Forecast:
    """statsmodels ARDL on means of 8 rows (2 min): four lags of the reading, four of T and its square."""
    from statsmodels.tsa.ardl import ARDL

    def causes(T_all: Array) -> Array:
        excess = T_all - T.mean()
        return np.column_stack([means(excess, 8), means(excess**2, 8)])

    model = ARDL(means(y, 8), 4, causes(T), 4, trend="c").fit()

    def forecast(t_new: Array, T_new: Array) -> Array:
        later = causes(T_new)
        first = len(T) // 8
        return between(t_new, np.asarray(model.predict(first, first + len(later) - 1, exog_oos=later)), 8)

    return forecast


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


def pysindy(t: Array, T: Array, y: Array) -> Forecast:
    """PySINDy's DiscreteSINDy on means of 20 rows (5 min): one state, degree 2, T of this step and the next.

    SINDy in continuous time, reading and temperature smoothed alike, does as well and simulates several times slower.
    """
    import pysindy as ps

    def control(T_all: Array) -> Array:
        excess = means(T_all - T.mean(), 20)
        return np.column_stack([excess[:-1], excess[1:]])

    scale = y.std()
    x = (means(y, 20) - y.mean()) / scale
    model = ps.DiscreteSINDy(
        optimizer=ps.STLSQ(threshold=1e-3, alpha=1e-6), feature_library=ps.PolynomialLibrary(degree=2)
    )
    model.fit(x[:-1, None], t=1, x_next=x[1:, None], u=control(T))

    def forecast(t_new: Array, T_new: Array) -> Array:
        later = control(np.append(T[-20:], T_new))
        simulated = model.simulate(x[-1:], len(later) + 1, u=np.append(later, later[-1:], axis=0))[1:, 0]
        return y.mean() + scale * between(t_new, simulated, 20)

    return forecast


def frols_nfir(t: Array, T: Array, y: Array) -> Forecast:
    """SysIdentPy's FROLS, NFIR of degree 2 on means of 20 rows (5 min): two hours of T, the best 40 terms.

    Order selection by BIC stops at the first rise, with worse forecasts in both of these, and takes far longer.
    """
    return _frols(20, {"model_type": "NFIR", "ylag": 1, "xlag": list(range(1, 25)), "n_terms": 40}, T, y)


def frols_narx(t: Array, T: Array, y: Array) -> Forecast:
    """SysIdentPy's FROLS, NARX of degree 2 on means of 8 rows (2 min): four lags each, the best 20 terms."""
    return _frols(8, {"ylag": [1, 2, 3, 4], "xlag": [1, 2, 3, 4], "n_terms": 20}, T, y)


def _frols(rows: int, settings: dict[str, Any], T: Array, y: Array) -> Forecast:
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    u, v = means(T - T.mean(), rows)[:, None], means(y - y.mean(), rows)[:, None]
    model = FROLS(
        basis_function=Polynomial(degree=2), estimator=LeastSquares(), order_selection=False, elag=1, **settings
    )
    model.fit(X=u[1:], y=v[:-1])  # its lags begin at 1: one step ahead, so that T of the same block takes part
    known = model.max_lag

    def forecast(t_new: Array, T_new: Array) -> Array:
        later = np.append(u[1 - known :], means(T_new - T.mean(), rows)[:, None], axis=0)
        later = np.append(later, later[-1:], axis=0)  # lag 0 is not used: any value
        simulated = model.predict(X=later, y=v[-known:])[known:, 0]
        return y.mean() + between(t_new, simulated, rows)

    return forecast


TOOLS: dict[str, tuple[str, Fit]] = {
    "static": ("static quadratic (numpy.polyfit)", static_quadratic),
    "defaults": ("thermocorr, defaults", defaults),
    "products": ("thermocorr, products=True", products),
    "search": ("thermocorr, TimeConstantSearch, 50 sets", search),
    "search2": ("thermocorr, search, then all products", search_all_products),
    "grid": ("GridSearchCV, 50 sets", grid_search),
    "grid2": ("GridSearchCV, 50 sets, all products", grid_search_squares),
    "ols": ("statsmodels OLS, 50 sets", ols),
    "varpro": ("scipy least_squares, 3 lags", variable_projection),
    "varpro2": ("scipy least_squares, 2 lags, all products", variable_projection_squares),
    "ardl": ("statsmodels ARDL, 2 min", ardl),
    "pastas": ("Pastas, double exponentials, 2 min", pastas),
    "pysindy": ("PySINDy, one discrete state, 5 min", pysindy),
    "nfir": ("SysIdentPy FROLS NFIR, 5 min", frols_nfir),
    "narx": ("SysIdentPy FROLS NARX, 2 min", frols_narx),
}


# Measuring


def make(options: argparse.Namespace, nonlinearity: float, seed: int) -> tuple[Array, Array, Array, Array]:
    """Times [s], temperature, reading and noise of one record."""
    rows = options.rows // BLOCK * BLOCK
    record, truth = make_record(
        rows,
        sampling_period=STEP,
        device=options.device,
        setting="lab",
        noise=NOISE,
        nonlinearity=nonlinearity,
        seed=seed,
        return_truth=True,
    )
    return STEP * np.arange(rows), *(a.to_numpy() for a in (record["temperature"], record["reading"], truth["noise"]))


def learned_rows(rows: int) -> int:
    """Number of rows to learn on."""
    return round(SHARE * rows) // BLOCK * BLOCK


def fit_predict(fit: Fit, t: Array, T: Array, y: Array, n_learn: int) -> tuple[Array, float, float]:
    """Readings that the tool expects in the test part, time of the fit (median of up to five), of the forecast [s]."""
    spent: list[float] = []
    while len(spent) < 5 and sum(spent) < 2.0:
        began = time.perf_counter()
        forecast = fit(t[:n_learn], T[:n_learn], y[:n_learn])
        spent.append(time.perf_counter() - began)
    began = time.perf_counter()
    expected = np.asarray(forecast(t[n_learn:], T[n_learn:]))
    return expected, float(np.median(spent)), time.perf_counter() - began


def peak(fit: Fit, t: Array, T: Array, y: Array, n_learn: int) -> float:
    """Peak of the fit's allocations [MiB]."""
    tracemalloc.start()
    try:
        fit(t[:n_learn], T[:n_learn], y[:n_learn])
        return tracemalloc.get_traced_memory()[1] / 2**20
    finally:
        tracemalloc.stop()


def rms(values: Array) -> float:
    """Root mean square, over the noise."""
    return float(np.sqrt(np.mean(values**2))) / NOISE


def measure(fit: Fit, records: dict[str, list[tuple[Array, Array, Array, Array]]]) -> str:
    """Figures of one tool as a line of the table."""
    fits, forecasts, residuals = [], [], []
    for device in records.values():
        ratios = []
        for t, T, y, _ in device:
            n = learned_rows(len(t))
            expected, fit_time, forecast_time = fit_predict(fit, t, T, y, n)
            ratios.append(rms(y[n:] - expected))
            fits.append(fit_time)
            forecasts.append(forecast_time)
        residuals.append(f"{np.median(ratios):10.3f}")
    t, T, y, _ = next(iter(records.values()))[0]
    memory = peak(fit, t, T, y, learned_rows(len(t)))
    return f"{np.median(fits):8.3f} {np.median(forecasts):10.3f} {memory:8.1f} " + " ".join(residuals)


def line(name: str, fit: Fit, short: tuple[Array, ...], records: dict[str, Any]) -> str:
    """Line of the table, or why there is none."""
    try:
        try:
            fit_predict(fit, *short[:3], learned_rows(len(short[0])))
        except ImportError:
            raise
        except Exception:  # a short record may be too short; the real ones decide
            pass
        return f"{name:42s} {measure(fit, records)}"
    except ModuleNotFoundError as error:
        return f"{name:42s} not installed ({error.name})"
    except ImportError as error:
        return f"{name:42s} not installed ({str(error).splitlines()[0]})"
    except Exception as error:
        first = (str(error).splitlines() or [""])[0]
        return f"{name:42s} {type(error).__name__}: {first}"


def versions() -> str:
    """Versions of the packages at hand."""
    found = [f"python {platform.python_version()}, thermocorr {thermocorr.__version__}"]
    for name in PACKAGES:
        try:
            found.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            continue
    return ", ".join(found)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=84_000)
    parser.add_argument("--device", default="slab", help="device of make_record (default slab)")
    parser.add_argument("--nonlinearity", type=float, default=0.1, help="of the nonlinear device [1/K] (default 0.1)")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3], help="a record of each device per seed")
    parser.add_argument("--tools", help=f"comma-separated, of {','.join(TOOLS)} (default all)")
    parser.add_argument("--quick", action="store_true", help="12 000 rows, one seed")
    options = parser.parse_args()
    if options.quick:
        options.rows, options.seeds = 12_000, options.seeds[:1]
    names = options.tools.split(",") if options.tools else list(TOOLS)
    if unknown := sorted(set(names) - set(TOOLS)):
        parser.error(f"unknown tools {', '.join(unknown)}; there are {', '.join(TOOLS)}")
    warnings.simplefilter("ignore")
    logging.disable(logging.WARNING)
    with threadpool_limits(1):
        print(f"one BLAS thread; {versions()}")
        devices = {"linear": 0.0, "nonlinear": options.nonlinearity}
        records = {name: [make(options, value, seed) for seed in options.seeds] for name, value in devices.items()}
        short = make(argparse.Namespace(rows=4_000, device=options.device), options.nonlinearity, 0)
        print(
            f"{options.device}, {options.rows} rows, {STEP:g} s, seeds {options.seeds}, nonlinearity "
            f"{options.nonlinearity:g}/K; free-run residual over noise, medians; memory by tracemalloc"
        )
        print(f"{'tool':42s} {'fit/s':>8s} {'forecast/s':>10s} {'MiB':>8s} " + " ".join(f"{d:>10s}" for d in records))
        floor = [np.median([rms(w[learned_rows(len(w)) :]) for _, _, _, w in device]) for device in records.values()]
        print(f"{'noise alone':42s} {'':28s} " + " ".join(f"{value:10.3f}" for value in floor))
        for name in names:
            print(line(TOOLS[name][0], TOOLS[name][1], short, records), flush=True)


if __name__ == "__main__":
    main()
