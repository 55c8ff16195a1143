"""The tools that `peers.py` compares: each learns times, temperatures and readings, and gives a forecast."""

from __future__ import annotations

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

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor, TimeConstantSearch
from thermocorr.effects import LagProducts

STEP = 15.0  # [s]

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
    """DynamicBiasRegressor as it comes: static quadratic, lags and their products chosen by itself."""
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
