"""Prior from a fleet of like devices: the mean and covariance of their laws.

The coefficients of each device are drawn from one normal distribution (a random-effects model); its mean and covariance
are estimated by expectation and maximisation, each device weighing as much as its record determines it (Laird & Ware
1982, Biometrics 38, 963). A unit with a short record of its own is fitted with that distribution as its prior.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from math import comb
from numbers import Integral
from typing import Any

import numpy as np

from ..effects import InitialTransient, LaggedCovariate, SeveralSteps, StaticPolynomial, ThermalLag
from ..effects.protocol import Effect, time_text
from ..equations import RidgeSolution, TriangularFactor
from ..records import RecordError
from .features import DiffusiveFeatures
from .fitting import Swept, white_errors

FEWEST = 3
"""Devices of a fleet that say something of one more."""
PASSES = 200
LEAST = 1e-100
"""Stands for zero where something is divided by it."""


@dataclass(frozen=True, kw_only=True)
class LawPrior:
    """Distribution of the coefficients of a fleet's devices: of the law, without start-up decays and steps.

    Examples
    --------
    >>> from thermocorr import DynamicBiasRegressor
    >>> from thermocorr.datasets import make_record
    >>> from thermocorr.estimators.prior import LawPrior
    >>> records = [make_record(3000, seed=seed) for seed in range(4)]
    >>> fleet = [DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(r, r["reading"]) for r in records]
    >>> LawPrior.of(fleet).columns
    ('temperature', 'temperature^2', 'lag[300 s]', 'lag[5400 s]')
    """

    columns: tuple[str, ...]
    mean: np.ndarray
    """Shape (p,)."""
    covariance: np.ndarray
    """Covariance between devices, shape (p, p)."""
    spread: np.ndarray
    """Usual covariance of the columns in a device's record, shape (p, p)."""
    noise: float
    """Usual standard deviation of a device's residuals, as large as if they were white."""
    reference_temperature: float
    """T0 to which the coefficients belong."""
    time_constants: Any
    """As the parameter has them."""
    temperature_range: tuple[float, float]
    """Lowest and highest temperature that a device was fitted at."""
    n_devices: int

    @classmethod
    def of(cls, models: Sequence[Any]) -> LawPrior:
        """Learn it from fitted models of several devices.

        Parameters
        ----------
        models : sequence of DynamicBiasRegressor
            With the same columns: the same effects and time constants (``fit_fleet(shared_time_constants=True)``).

        Raises
        ------
        ValueError
            For fewer than three, and for models that differ in more than their coefficients.
        """
        if len(models) < FEWEST:
            raise ValueError(f"A fleet of {len(models)} tells too little of one more device: {FEWEST} are the least.")
        laws = [model._law() for model in models]
        names = laws[0].columns
        for number, law in enumerate(laws):
            if law.columns != names:
                raise ValueError(
                    f"Devices 0 and {number} of the fleet have other columns: {list(names)} and {list(law.columns)}. "
                    "Fit all with the same effects and time constants (shared_time_constants=True)."
                )
        T0 = float(np.mean([law.reference_temperature for law in laws]))
        laws = [law.at(T0) for law in laws]
        scale = np.median([law.scale for law in laws], axis=0)
        mean, covariance = _drawn_from(
            np.array([law.coef * scale for law in laws]),
            np.array([law.triangle.T @ law.triangle / np.outer(scale, scale) / law.noise**2 for law in laws]),
        )
        return cls(
            columns=names,
            mean=mean / scale,
            covariance=covariance / np.outer(scale, scale),
            spread=np.mean([law.triangle.T @ law.triangle / law.n_rows for law in laws], axis=0),
            noise=float(np.median([law.noise for law in laws])),
            reference_temperature=T0,
            time_constants=models[0]._fixed_time_constants(),
            temperature_range=(
                min(law.temperature_range[0] for law in laws),
                max(law.temperature_range[1] for law in laws),
            ),
            n_devices=len(models),
        )

    @classmethod
    def given(cls, prior: Any) -> LawPrior | None:
        """The parameter `prior`: one of these, its `as_dict`, or the fitted models of a fleet; None for none."""
        if prior is None or isinstance(prior, LawPrior):
            return prior
        if isinstance(prior, Mapping) and "covariance" in prior:
            return cls._read(prior)
        models = list(prior.values()) if isinstance(prior, Mapping) else prior
        if not isinstance(models, list | tuple) or not all(hasattr(model, "_law") for model in models):
            raise ValueError(
                f"The 'prior' parameter must be a Fleet (from fit_fleet) or a LawPrior. Got {prior!r:.60} instead."
            )
        if not all(hasattr(model, "pipeline_") for model in models):
            raise ValueError(
                "The models of the 'prior' are not fitted: clone() takes the fit from a list or a dict of models. Pass "
                "the Fleet that fit_fleet returns, or LawPrior.of(models)."
            )
        return cls.of(models)

    @classmethod
    def _read(cls, prior: Mapping[str, Any]) -> LawPrior:
        if set(prior) != {each.name for each in fields(cls)}:
            raise ValueError(f"The 'prior' parameter has the entries {sorted(map(str, prior))}: that is no LawPrior.")
        columns = tuple(map(str, prior["columns"]))
        dimensions = {"mean": 1, "covariance": 2, "spread": 2}
        arrays = {name: np.asarray(prior[name], float) for name in dimensions}
        right = all(arrays[name].shape == (len(columns),) * n for name, n in dimensions.items())
        if not right or not all(np.isfinite(array).all() for array in (*arrays.values(), prior["noise"])):
            raise ValueError("The 'prior' parameter holds numbers that are no distribution of its columns.")
        low, high = map(float, prior["temperature_range"])
        return cls(**{**prior, **arrays, "columns": columns, "temperature_range": (low, high)})

    def as_dict(self) -> dict[str, Any]:
        """Plain lists and numbers."""
        lists = (np.ndarray, tuple)
        return {name: np.array(v).tolist() if isinstance(v, lists) else v for name, v in asdict(self).items()}

    def rows(self, effects: Sequence[Effect], thermometers: Collection[Any] = ()) -> TriangularFactor:
        """Rows of ``[1 | Q | U]`` that say as much as the prior, for a model with these learned effects.

        Parameters
        ----------
        effects : sequence of Effect
        thermometers : collection of column names
            Columns whose lags are those of a temperature.

        Raises
        ------
        ValueError
            For a model without the columns of the fleet.
        """
        names = [name for effect in effects for name in effect.names()]
        lacking = [name for name in self.columns if name not in names]
        if lacking:
            raise ValueError(f"The fleet's devices have {lacking[0]!r} in their law, and this model has only {names}.")
        root = np.linalg.cholesky(np.linalg.inv(self.covariance)).T
        rows = np.zeros((len(self.columns), len(names) + 2))
        rows[:, [1 + names.index(name) for name in self.columns]] = self.noise * root
        rows[:, -1] = self.noise * root @ self.mean
        at, lags = 1, self._lags(effects, thermometers)
        for effect in effects:
            width = effect.n_columns()
            if isinstance(effect, InitialTransient):
                starts = [
                    self._starts(taus, lags, at + effect.first_column_[key], rows.shape[1])
                    for key, taus in effect.decays_.items()
                ]
                rows = np.vstack((rows, *starts))
            at += width
        factor = TriangularFactor(rows.shape[1]).update(np.asfortranarray(rows))
        factor.n_rows = 0
        return factor

    def _lags(self, effects: Sequence[Effect], thermometers: Collection[Any]) -> dict[float, int]:
        """Time constant -> the law's column that follows a temperature so late, the nearest thermometer first."""
        found: dict[float, int] = {}
        for effect in effects:
            of_thermometer = isinstance(effect, LaggedCovariate) and effect.column in thermometers
            if isinstance(effect, ThermalLag) or of_thermometer:
                names = effect.names()[::-1]  # lags stand behind what they follow
                for tau, name in zip(effect.time_constants_[::-1], names, strict=False):
                    if name in self.columns:
                        found.setdefault(tau, self.columns.index(name))
        return found

    def _starts(self, time_constants: np.ndarray, lags: Mapping[float, int], at: int, width: int) -> np.ndarray:
        """Rows on the start-up decays of a segment, from column `at` on: as large together as the lags usually are."""
        for tau in time_constants:
            if tau not in lags:
                lag = f"lag[{time_text(tau)}]"
                raise ValueError(f"The fleet's devices have no {lag!r} in their law: {list(self.columns)}.")
        which = [lags[tau] for tau in time_constants]
        size = self.mean[which]
        covariance = self.spread[np.ix_(which, which)] * np.outer(size, size)
        covariance += np.diag(1e-6 * np.diag(covariance) + (1e-3 * self.noise) ** 2)
        rows = np.zeros((len(which), width))
        rows[:, at : at + len(which)] = self.noise * np.linalg.cholesky(np.linalg.inv(covariance)).T
        return rows


def known_before(model: Any, features: DiffusiveFeatures) -> LawPrior | None:
    """The prior of a model; its features get the time constants and T0 of the fleet, unless the user gave others.

    Start-up decays as long as the record are safe beside it.
    """
    prior = LawPrior.given(model.prior)
    if prior is None:
        return None
    if isinstance(model.time_constants, str | Integral):
        features.set_params(time_constants=prior.time_constants)
    if model.reference_temperature == "mean":
        features.set_params(reference_temperature=prior.reference_temperature)
    elif model.reference_temperature != prior.reference_temperature:
        raise ValueError(
            f"The fleet's laws are about {prior.reference_temperature:.6g}, and this model has "
            f"reference_temperature={model.reference_temperature!r}. Leave it at 'mean', or fit the fleet with it."
        )
    # Share of the record over which decays are fitted: their sizes are known before
    features.decay_share = 1e6
    return prior


def check_like(prior: LawPrior, mean_temperature: float, residual: float) -> str:
    """A sentence on a device that is unlike the fleet; RecordError for a temperature in another unit."""
    # A temperature so far from the fleet's T0 is in another unit [K]
    if abs(mean_temperature - prior.reference_temperature) > 100.0:
        raise RecordError(
            f"The temperature is about {mean_temperature:.4g} here and was about {prior.reference_temperature:.4g} in "
            "the fleet: that looks like another unit. Convert it first."
        )
    # Residuals this many times the fleet's are of another kind of device, or in another unit
    if residual <= 10.0 * prior.noise:
        return ""
    return (
        f"The residuals are {residual / prior.noise:.2g} times those of the fleet: the device is not like the others, "
        "or its readings are in another unit."
    )


@dataclass(frozen=True, kw_only=True)
class Law:
    """Coefficients of one device, and what its record says of them."""

    columns: tuple[str, ...]
    coef: np.ndarray
    triangle: np.ndarray
    """Factor of the columns less what start-up decays, steps and U0 explain of them, shape (p, p)."""
    scale: np.ndarray
    """Standard deviation of each column, shape (p,)."""
    n_rows: int
    noise: float
    """Standard deviation of the residuals, as large as if they were white."""
    reference_temperature: float
    temperature_range: tuple[float, float]
    powers: tuple[int, ...]
    """Power of T - T0 of each column, 0 for other columns."""
    bent: bool
    """True if other columns depend on T0."""

    def at(self, T0: float) -> Law:
        """The law about another reference temperature."""
        shift = T0 - self.reference_temperature
        if not shift:
            return self
        if self.bent:
            raise ValueError(
                "The devices have products with T - T0 in their law, and different T0. Fit all with the same "
                "reference_temperature, in degC."
            )
        into = np.eye(len(self.coef))  # (u + shift)^k = sum of comb(k, j) shift^(k - j) u^j
        for i, k in enumerate(self.powers):
            for j, power in enumerate(self.powers):
                if k and 0 < power <= k:
                    into[j, i] = comb(k, power) * shift ** (k - power)
        triangle = self.triangle @ np.linalg.inv(into)
        return Law(**{**vars(self), "coef": into @ self.coef, "triangle": triangle, "reference_temperature": T0})


def law_of(
    effects: Sequence[Effect],
    swept: Swept,
    solution: RidgeSolution,
    errors: np.ndarray,
    *,
    reference_temperature: float,
    temperature_range: tuple[float, float],
) -> Law:
    """The law of a fitted model, from its effects, factors, solution and standard errors of all coefficients."""
    names = [name for effect in effects for name in effect.names()]
    own = [isinstance(effect, InitialTransient | SeveralSteps) for effect in effects for _ in effect.names()]
    law, starts = np.flatnonzero(~np.array(own, bool)), np.flatnonzero(own)
    total = swept.total()
    ordered = total.select([0, *(1 + starts), *(1 + law), len(names) + 1])
    triangle = ordered.r[1 + len(starts) : -1, 1 + len(starts) : -1]
    n_rows = max(total.n_rows, 1)
    white = white_errors(solution, np.eye(1 + len(names)))[1 + law]
    ratio = np.divide(errors[1 + law], white, out=np.ones(len(law)), where=white > 0)
    noise = np.sqrt(solution.residual_sum_of_squares / n_rows) * float(np.median(np.maximum(ratio, 1.0)))
    powers = [
        power
        for effect in effects
        for power in (effect.powers() if isinstance(effect, StaticPolynomial) else [0] * effect.n_columns())
    ]
    return Law(
        columns=tuple(names[i] for i in law),
        coef=solution.coef[law],
        triangle=triangle,
        scale=np.maximum(np.linalg.norm(triangle, axis=0) / np.sqrt(n_rows), LEAST),
        n_rows=n_rows,
        noise=float(noise) or LEAST,
        reference_temperature=reference_temperature,
        temperature_range=temperature_range,
        powers=tuple(powers[i] for i in law),
        bent=any(effect.is_product for effect in effects),
    )


def _drawn_from(estimates: np.ndarray, information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of the devices' coefficients, shape (p,) and (p, p).

    `estimates` (array of shape (n, p)): Coefficients of each device, on a common scale. `information` (array of shape
    (n, p, p)): Inverse of the covariance of each device's own estimate.
    """
    mean = estimates.mean(axis=0)
    # Devices are taken to differ by this share of the mean of their laws at least
    least = (1e-4 * np.abs(mean).max()) ** 2 * np.eye(len(mean))
    covariance = np.cov(estimates.T).reshape(least.shape) + least
    said = np.einsum("nij,nj->ni", information, estimates)
    for _ in range(PASSES):
        inverse = np.linalg.inv(covariance)
        spread = np.linalg.inv(information + inverse)
        each = np.einsum("nij,nj->ni", spread, said + inverse @ mean)
        mean = each.mean(axis=0)
        before, covariance = covariance, spread.mean(axis=0) + (each - mean).T @ (each - mean) / len(each) + least
        # Relative change of the covariance at which the estimation ends
        if np.abs(covariance - before).max() <= 1e-6 * np.abs(covariance).max():
            break
    return mean, covariance
