"""`Sensor`, noise and joint errors of a fit, after the GUM."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Any

import numpy as np

from ..effects.expressions import follows_temperature
from ..effects.protocol import Effect
from ..effects.signals import DelayState
from ..effects.stream import Walked, resume, walk
from ..equations import LagState, RidgeSolution
from ..records import Block, History, Record
from ..records.types import Loose, Size, Sizes, Variance, Vector
from ..records.units import difference_unit
from .covariance import BandSums, Basis, Restricted, ScaledBasis, basis_of
from .fitting import Swept
from .spectrum import TOLERANCE


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """Standard uncertainties of the thermometer, type B.

    Parameters
    ----------
    drift_since_learning : float, default 0.0
        How far its error may have moved since the record was fitted [K]. A constant error cancels: the model has
        learned what the reading does at the temperatures that this thermometer shows.
    calibration : float, default 0.0
        Of its calibration [K]. It cancels where the same thermometer, uncalibrated since, serves for learning and for
        correcting; it counts where `exchanged`.
    exchanged : bool, default False
        Whether another thermometer served for learning.
    noise : float or "auto", default "auto"
        Of one of its readings, beyond the noise it had while learning [K]. "auto": it is the thermometer of the fitted
        record, whose noise is in the residuals already.
    time_constant : float, default 0.0
        How far its lag may differ from the one it had while learning [s].
    """

    drift_since_learning: float = 0.0
    calibration: float = 0.0
    exchanged: bool = False
    noise: float | str = "auto"
    time_constant: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no uncertainty."""
        if not isinstance(self.exchanged, bool):
            raise ValueError(
                f"The 'exchanged' parameter of Sensor must be True or False. Got {self.exchanged!r} instead."
            )
        for name in ("drift_since_learning", "calibration", "noise", "time_constant"):
            value = getattr(self, name)
            if name == "noise" and isinstance(value, str) and value == "auto":
                continue
            if isinstance(value, bool) or not isinstance(value, Real) or not 0 <= float(value) < np.inf:
                unit = "s" if name == "time_constant" else "K"
                raise ValueError(
                    f"The {name!r} parameter of Sensor must be a standard uncertainty in {unit}, zero or above. "
                    f"Got {value!r} instead."
                )

    @property
    def offset(self) -> float:
        """Standard uncertainty of an error that stays [K]."""
        return float(np.hypot(self.drift_since_learning, self.calibration if self.exchanged else 0.0))

    @property
    def own_noise(self) -> float:
        """Noise of one temperature, beyond what was learned [K]."""
        return 0.0 if isinstance(self.noise, str) else float(self.noise)


@dataclass(frozen=True, kw_only=True)
class Reference:
    """Reference with which the level of the readings was set."""

    uncertainty: float = 0.0
    """Standard uncertainty, in the unit of the reading."""
    dof: float = np.inf
    declared: bool = False


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """White noise, short noise and Ornstein-Uhlenbeck parts.

    Variances in the unit of the reading squared.
    """

    white: Variance
    """Variance of one reading by noise that is white, or forgotten within `recent`."""
    recent: Size
    """Correlation time of that part [s]; 0 for white noise."""
    wander: Sizes
    """Variances of the parts, shape (parts,)."""
    correlation_times: Sizes
    """Correlation times of the parts [s], increasing."""
    white_dof: Loose
    """Degrees of freedom of `white`."""
    wander_dof: Loose
    """Degrees of freedom of the wandering variance."""
    size_seconds: Vector = field(default_factory=lambda: np.zeros(0))
    """Times at which the size of the noise is known, where it changes in the course of the record [s]."""
    sizes: Sizes = field(default_factory=lambda: np.zeros(0))
    """Size of the noise then, over the one that the variances are of."""

    def __post_init__(self) -> None:
        """Refuse parts that do not belong together."""
        alike = np.shape(self.wander) == np.shape(self.correlation_times) and np.ndim(self.wander) == 1
        known = np.shape(self.sizes) == np.shape(self.size_seconds) and np.ndim(self.sizes) == 1
        if not (alike and known and self.white_dof > 0 and self.wander_dof > 0):
            raise ValueError("a noise has a correlation time for each part, and a size for each moment")

    @property
    def wander_variance(self) -> float:
        """Variance of all wandering parts together."""
        return float(self.wander.sum())

    @property
    def variance(self) -> float:
        """Variance of one reading."""
        return self.white + self.wander_variance

    def unpredicted(self, step: float) -> float:
        """Variance of a reading about its best forecast.

        It is what a diagnosis calls the noise floor, squared.
        """
        times, sizes = np.append(self.correlation_times, self.recent), np.append(self.wander, self.white)
        with np.errstate(divide="ignore", under="ignore"):
            kept = np.exp(-step / times)
        cosine = np.cos(np.pi * (np.arange(2048) + 0.5) / 2048)[:, None]
        power = (1 - kept**2) / (1 - 2 * kept * cosine + kept**2) @ sizes
        return float(np.exp(np.mean(np.log(np.maximum(power, np.finfo(float).tiny)))))

    @property
    def memory(self) -> float:
        """Mean correlation time of the wandering parts [s]."""
        total = self.wander_variance
        return float(self.wander @ self.correlation_times) / total if total > 0 else 0.0

    def size(self, seconds: np.ndarray) -> np.ndarray:
        """Relative size of the noise at times [s].

        For what comes later, and before: the nearest one known, and its root mean square over the record at least. Of a
        noise that went on growing nothing better is known; one that goes with the temperature will be large again.
        """
        if not len(self.sizes):
            return np.ones(len(seconds))
        known = np.interp(seconds, self.size_seconds, self.sizes)
        usual = float(np.sqrt(np.mean(self.sizes**2)))
        apart = (seconds < self.size_seconds[0]) | (seconds > self.size_seconds[-1])
        return np.asarray(np.where(apart, np.maximum(known, usual), known))

    @property
    def dof(self) -> float:
        """Degrees of freedom of `variance` (Welch and Satterthwaite)."""
        spread = self.white**2 / self.white_dof + self.wander_variance**2 / self.wander_dof
        return self.variance**2 / spread if spread > 0 else np.inf

    def covariance(self, seconds: np.ndarray, runs: np.ndarray) -> np.ndarray:
        """Covariance of the noise of readings, (n, n)."""
        lag, size = np.abs(seconds[:, None] - seconds), self.size(seconds)
        with np.errstate(under="ignore"):
            total = np.exp(-lag / self.recent) * self.white if self.recent > 0 else self.white * np.eye(len(seconds))
            for variance, time in zip(self.wander.tolist(), self.correlation_times.tolist(), strict=True):
                if variance > 0:
                    total += variance * np.exp(-lag / time)
        return np.asarray(total * (runs[:, None] == runs) * size[:, None] * size)

    def of_mean(self, seconds: np.ndarray, runs: np.ndarray | None = None) -> tuple[float, float]:
        """Variances of a mean of readings: white, wandering.

        With the number of each reading's run, shape (n,): the noise of different runs is independent.
        """
        if runs is not None and (runs != runs[0]).any():
            each = [(runs == run) for run in np.unique(runs)]
            of_runs = [np.mean(one) ** 2 * np.array(self.of_mean(seconds[one])) for one in each]
            white, slow = np.sum(of_runs, axis=0).tolist()
            return white, slow
        steps = np.diff(np.sort(np.asarray(seconds, float)))
        larger = float(np.mean(self.size(seconds) ** 2))
        parts = zip(self.wander.tolist(), self.correlation_times.tolist(), strict=True)
        wander = sum(variance * _mean_correlation(steps, time) for variance, time in parts if variance > 0)
        return larger * self.white * _mean_correlation(steps, self.recent), larger * float(wander)


def _mean_correlation(steps: np.ndarray, correlation_time: float) -> float:
    """Mean of exp(-|t_i - t_j| / correlation_time) over all pairs."""
    n = len(steps) + 1
    if correlation_time <= 0 or n == 1:
        return 1 / n
    with np.errstate(under="ignore"):
        kept = np.exp(-steps / correlation_time)
    # Steps equal to 1e-9, and neighbours whose correlation leaves the series' sum its digits:
    if np.ptp(steps) <= 1e-9 * steps[0] and kept[0] < 1 - 1e-5:  # a geometric series
        k = float(kept[0])
        return float((n + 2 * k * (n - 1 - n * k + k**n) / (1 - k) ** 2) / n**2)
    behind = before = 0.0
    for k in kept.tolist():  # sum of correlations with all earlier times
        before = k * (before + 1.0)
        behind += before
    return (n + 2 * behind) / n**2


UNKNOWN = (
    "This model does not know the noise of the record it was fitted to: it was fitted to readings with weights. Fit it "
    "again without weights to have uncertainties."
)


@dataclass(frozen=True, kw_only=True)
class JointErrors:
    """Coefficients, their covariance, and the noise.

    Where time constants were searched, the columns are lags of the whole grid, with a prior: what the chosen few leave
    out counts, too. The fit's own error is that of this estimate plus the distance between the two.
    """

    effects: list[Effect] = field(compare=False)
    history: History = field(compare=False)
    own: bool = field(compare=False)
    """True if these are the model's own effects."""
    coef: Vector
    """Intercept and coefficients by generalised least squares, shape (1 + p,)."""
    half: Vector
    """``half @ half.T`` is their covariance, shape (1 + p, rank)."""
    dof: Loose
    """Degrees of freedom of the bias's variance."""
    usual: Variance
    """Mean variance of the bias over the fitted record, the fit's distance from the best estimate left aside."""
    mean: Vector
    """Mean of the columns over the record, 1 first, shape (1 + p,)."""
    noise: NoiseModel
    end: Size
    """Time of the record's end since it began [s]."""
    representation: Variance
    """Variance of what the chosen time constants may leave of the modelled reading."""

    def combined(self, columns: np.ndarray, value: np.ndarray) -> np.ndarray:
        """Standard errors of combinations of columns, (k,).

        `columns` (array of shape (k, p)): Of `effects`. `value` (array of shape (k,)): The same by the fit.
        """
        variance = np.sum((columns @ self.half[1:]) ** 2, axis=1) + (columns @ self.coef[1:] - value) ** 2
        return np.asarray(np.sqrt(variance + self.representation))


PER_MEMORY = 2.0
"""Degrees of freedom that a correlation time adds to a wandering variance: a sum of squares alone would give 1, a known
shape of the spectrum more. Corrected readings in a random walk are covered in 100, 99, 96 % with 1, 2, 4 (time
constants given) and 100, 98, 95 % (searched): `python benchmarks/interval_coverage.py --first 600 --seeds 24`."""


def joint_errors(model: Any, swept: Swept, solution: RidgeSolution) -> JointErrors:
    """Errors of a fitted model, from its sweep.

    The slowest bodies may be the device's in a short record; in one that wanders they would take the noise upon
    themselves. They stay if they make the record likelier.

    Raises ValueError where the record was not averaged.
    """
    if swept.binned is None:
        raise ValueError(UNKNOWN)
    basis = basis_of(model, swept.binned, swept.reading_offset)
    scaled = ScaledBasis.of(basis)
    groups = [group / scaled.norms**2 for group in basis.groups]
    sums = BandSums(scaled.columns, scaled.reading, scaled.span, groups).settle()
    kept = np.ones(len(basis.slow), bool)
    if basis.slow.any():
        fewer = sums.without(basis.slow).settle()
        if fewer.evidence() > sums.evidence():
            sums, kept = fewer, ~basis.slow
    found = sums.estimate()
    residual = solution.residual_sum_of_squares / max(solution.n_rows, 1)
    free, scale, columns = basis.free[kept], scaled.unit / scaled.norms[kept], basis.columns[:, kept]
    left = scaled.unit * scaled.size * (scaled.reading - scaled.columns[:, kept] @ found.coef)
    coef, mean = np.zeros(basis.width), np.zeros(basis.width)
    coef[free] = found.coef * scale
    coef[0] += scaled.mean + basis.offset
    mean[free] = columns.mean(axis=0)
    values, vectors = np.linalg.eigh(found.covariance)
    half = np.zeros((basis.width, len(values)))
    half[free] = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    form = columns.T @ columns / len(columns) * scale[:, None] * scale
    form[free == 0] = form[:, free == 0] = 0.0  # the bias has no intercept
    return JointErrors(
        effects=basis.effects, history=basis.history, own=basis.own, coef=coef, half=half,
        dof=found.freedom(form), usual=float(np.sum(form * found.covariance)), mean=mean,
        noise=_noise(basis, scaled, sums, found, residual - float(np.mean(left**2))), end=float(basis.begins.max()),
        representation=TOLERANCE * residual if not basis.searched and model.search_ is not None else 0.0,
    )  # fmt: skip


def _noise(basis: Basis, scaled: ScaledBasis, sums: BandSums, found: Restricted, within: float) -> NoiseModel:
    """Noise of single readings, from that of bins."""
    theta, covariance, rows = found.theta, found.theta_covariance, basis.rows
    white = float(theta[0])
    if rows > 1:
        white = max(within, 0.0) / scaled.unit**2 * rows / (rows - 1) or white
    memory = rows * float(theta[0]) / white
    # Where the variance of a bin's mean exceeds that of white noise by a fifth, the noise within bins remembers.
    kept = (memory - 1) / (memory + 1) if memory > 1.2 else 0.0
    wander, spread = theta[1:], float(covariance[1:, 1:].sum())
    times, total = basis.bin_seconds() * sums.times, float(wander.sum())
    dof = 2 * total**2 / spread if spread > 0 else np.inf  # as long as the correlation times are right
    if total > 0:
        dof = min(dof, max(PER_MEMORY, PER_MEMORY * float(np.ptp(basis.begins)) * total / float(wander @ times)))
    # The size of a noise that changes with time is kept at 200 moments.
    at: np.ndarray = np.unique(np.linspace(0, len(scaled.size) - 1, 200).astype(int))
    at = np.argsort(basis.begins, kind="stable")[at]  # runs may be interleaved
    at = at[:0] if np.ptp(scaled.size) == 0 else at
    return NoiseModel(
        white=white * scaled.unit**2,
        recent=-basis.bin_seconds() / rows / float(np.log(kept)) if kept > 0 else 0.0,
        wander=wander * scaled.unit**2,
        correlation_times=times,
        white_dof=float(max(len(scaled.reading) - len(found.coef), 1)),
        wander_dof=dof,
        size_seconds=basis.begins[at],
        sizes=scaled.size[at],
    )


def sensor_variance(model: Any, record: Record, sensor: Sensor) -> tuple[np.ndarray, np.ndarray]:
    """Variance of the bias by the thermometer's offset and rest.

    The bias is differentiated by walking through the record once more, the temperature a little higher: every effect
    that uses it has its say.
    """
    n = record.n_rows
    fixed, own = np.zeros(n), np.zeros(n)
    if not (sensor.offset or sensor.own_noise or sensor.time_constant):
        return fixed, own
    low, high = model.reading_.temperature_range
    # The bias is differentiated over a share of the fitted range far above rounding.
    h = 1e-4 * (high - low)
    kelvin = 1.8 if difference_unit(model.reading_.temperature_unit) == "degF" else 1.0
    slope = kelvin * _moved(model, record, np.full(n, h), since_learning=True) / h
    fixed = (slope * sensor.offset) ** 2
    if sensor.own_noise:
        signs = np.random.default_rng(0).choice([-h, h], n)  # white, as the noise is: lags average it
        own = own + float(np.nanmean(_moved(model, record, signs) ** 2)) * (kelvin / h * sensor.own_noise) ** 2
    if sensor.time_constant:
        own = own + (slope / kelvin * _rate(record) * sensor.time_constant) ** 2
    return fixed, own


def _moved(model: Any, record: Record, change: np.ndarray, since_learning: bool = False) -> np.ndarray:
    """Change of the bias when the temperature changes, (n,).

    A change `since_learning` was there before the first row: lags have settled to it.
    """
    features = model.features_
    kept, starts, states = features.resume(record)
    T = np.asarray(kept.columns[kept.temperature_name][:], float) + change
    moved = replace(kept, columns={**kept.columns, kept.temperature_name: T}, known_moments={})
    result = np.full(record.n_rows, np.nan)
    later = states
    if since_learning:
        follow = [follows_temperature(effect) for effect in features.effect_list()]
        later = {
            key: [_settled(state, change[0]) if f else state for state, f in zip(own, follow, strict=True)]
            for key, own in states.items()
        }
    before = model._weighed(features.walk_resumed(kept, starts, states))
    after = model._weighed(features.walk_resumed(moved, starts, later))
    for (block, old), (_, new) in zip(before, after, strict=True):
        result[block.rows] = model._removed_part(new) - model._removed_part(old)
    return result


def _settled(state: Any, change: float) -> Any:
    """State of an effect after a long change of temperature."""
    if isinstance(state, LagState):
        return state._replace(temperature=state.temperature + change)
    if isinstance(state, DelayState):
        return state._replace(temperature=state.temperature + change)
    return tuple(_settled(one, change) for one in state) if type(state) is tuple else state


def _rate(record: Record) -> np.ndarray:
    """Rate of change of the temperature in each row [K/s]."""
    result = np.zeros(record.n_rows)
    for block in record.blocks():
        result[block.rows] = np.gradient(block.temperature, block.seconds) if len(block) > 1 else np.nan
    return result


@dataclass(frozen=True, kw_only=True)
class RowErrors:
    """Variances of a block's rows, (n,) each."""

    level: np.ndarray
    """The bias: what all rows of a record like the fitted one share."""
    coefficients: np.ndarray
    """The bias: the rest of what the coefficients make, and the distance of the fit from the best estimate."""
    noise: np.ndarray
    """Variance of the noise, over that of `NoiseModel.variance`."""
    columns: np.ndarray
    """What the coefficients are multiplied by, shape (n, 1 + p): for covariances between rows."""

    @property
    def bias(self) -> np.ndarray:
        """Variance of the bias, or of the modelled reading, without noise."""
        return np.asarray(self.level + self.coefficients)

    def of_readings(self, noise: NoiseModel) -> np.ndarray:
        """Variance of a corrected reading, or of a new one."""
        return np.asarray(self.bias + noise.variance * self.noise)


class ErrorWalk:
    """Walks through a record with a model and its joint errors.

    `model` (DynamicBiasRegressor): Fitted. `joint` (JointErrors): Of that model. `removed` (bool): Errors of the bias
    that `correct` removes; else of the modelled reading, U0 and all effects.
    """

    def __init__(self, model: Any, joint: JointErrors, removed: bool):
        self.model, self.joint, self.removed = model, joint, removed
        kept = [effect.removed_by_correct or not removed for effect in joint.effects for _ in effect.names()]
        with_level = not removed or model.features_.reference is not None
        self.used = np.array([with_level, *kept])
        shared = joint.mean[self.used] @ joint.half[self.used]
        size = float(np.linalg.norm(shared))
        self.level = shared / size if size > 0 else shared
        self.through = np.column_stack((joint.half, joint.half @ self.level, joint.coef))
        """What columns are multiplied by: directions of their covariance, what all rows share, the best estimate."""

    def blocks(self, record: Record) -> Iterator[tuple[Block, np.ndarray, np.ndarray, RowErrors]]:
        """Blocks with contributions, bias or model, and errors."""
        model, joint = self.model, self.joint
        own, starts, states = model.features_.resume(record)
        walked: list[Walked] = []

        def noted() -> Iterator[Walked]:
            for step in model.features_.walk_resumed(own, starts, states):
                walked[:] = [step]
                yield step

        wide: Iterator[Walked] = iter(())
        if not joint.own:
            kept, begun, known = resume(joint.effects, joint.history, record)
            wide = walk(joint.effects, kept, zero=joint.history.zero, starts=begun, states=known)
        parts = [effect.removed_by_correct or not self.removed for effect in model.features_.effect_list()]
        constant = model._removed_level if self.removed else model.intercept_
        for block, contributions in model._weighed(noted()):
            value = contributions[:, parts].sum(axis=1) + constant
            columns = next(wide, walked[0]).columns
            errors = self.errors(columns, block.seconds, value)
            yield block, contributions, value, errors

    def errors(self, columns: np.ndarray, seconds: np.ndarray, value: np.ndarray) -> RowErrors:
        """Errors of rows, from their columns (n, p).

        `columns` (array of shape (n, p)). `seconds` (array of shape (n,)): Since the fitted record began [s]. `value`
        (array of shape (n,)): What the model gives.
        """
        joint = self.joint
        Z = np.empty((len(columns), 1 + columns.shape[1]), order="F")
        Z[:, 0], Z[:, 1:] = 1.0, columns
        Z[:, ~self.used] = 0.0
        through = Z @ self.through
        level, distance = through[:, -2] ** 2, through[:, -1] - value
        rest = np.maximum(np.einsum("ij,ij->i", through[:, :-2], through[:, :-2]) - level, 0.0)
        return RowErrors(
            level=level,
            coefficients=rest + distance**2 + joint.representation,
            noise=joint.noise.size(seconds) ** 2,
            columns=Z,
        )
