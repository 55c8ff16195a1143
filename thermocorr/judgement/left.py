"""What is left beside every cause: whether it is white, how it wanders, and what this record could have shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pandas as pd

from ..effects import InitialTransient
from ..estimators.holdout import rms
from ..estimators.screening import BURST
from ..records.screen import CLIPPED, FILLED_IN, REPEAT
from .copies import together
from .levels import (
    DRIFT_TO_NOISE,
    DRIFT_TO_STEP,
    NINE_TENTHS,
    OF_THERMOMETER,
    PROVABLE,
    RANKED,
    TAILS,
    TO_A_DECADE,
    WANDERS,
)
from .likelihood import Comparison, filter_memory
from .pool import Pool
from .residual import quiet_rows
from .search import Search


class Loud(NamedTuple):
    """A stretch in which the noise is much larger than usual."""

    start: float
    """Since the record began [s]."""
    end: float
    size: float
    """Largest size over the usual one."""
    readings: int


@dataclass(frozen=True, kw_only=True)
class Left:
    """What no cause explains."""

    structured: bool
    """Whether it wanders clearly, beyond white noise."""
    floor: float
    """Standard deviation of one sample that nothing foresees, in the unit of y."""
    wandering: float
    """Standard deviation of the part that wanders, in the unit of y."""
    correlation_time: float
    """For how long that part remembers [s]; 0 where nothing wanders."""
    colour: float
    """Variance over innovation variance: 1 for white noise."""
    uneven: tuple[str, ...]
    """Labels of effects that a few stretches of the record follow, and the rest does not."""
    copied: tuple[str, ...]
    """Labels of effects of recorded columns that what is left follows hardly better than it follows copies of these
    columns moved in time: a few slow swings."""
    spikes: tuple[float, ...]
    """Times since the record began at which readings jump far out of the noise [s], at most ten: left out."""
    loud: tuple[Loud, ...]
    """Stretches of loud noise, the largest first, at most ten: their readings count less."""
    thermometers: pd.DataFrame = field(compare=False)
    """What the errors of the thermometers make in the reading, see `thermocorr.thermometer_errors`; empty where
    nothing wanders, and where the record was judged by averages."""
    smallest_drift: float
    """Drift over the record that it could have shown, in the unit of y; infinite where it could have shown none."""
    smallest_step: float
    """Step in the middle of the record that it could have shown, in the unit of y."""
    spectrum: pd.DataFrame = field(compare=False)
    """Amplitude spectral densities by frequency [Hz], in the unit of y over sqrt(Hz): ``residual`` beside all causes,
    ``noise`` as the judgement takes it, and its ``white`` part."""

    rounding: float = 0.0
    """Step of the reading, in its unit, where what is left is no more than its rounding; else 0."""
    tails: float = 1.0
    """Rms of the model's residual, stretches of loud noise aside, over what nine tenths of it say of Gaussian noise."""
    in_gaps: float = 0.0
    """Rms of what the temperature may have done in gaps to judged readings, in the unit of y; 0 where it is small."""
    unjudged: float = 0.0
    """Share of the readings that are behind gaps, or beside filled cells, and neither learned from nor judged; 0 where
    they are few."""
    unjudged_rms: float = 0.0
    """Rms residual of these readings, in the unit of y."""
    filtered: float = 0.0
    """How long noise remembers [s] that an instrument makes which filters or averages, see `filter_memory`; else 0."""
    drift_hides: bool = False
    """Whether a drift of several noises would pass for what model and causes have; False beside a model that has
    effects of time alone, and where the reading is exact."""

    start_or: tuple[str, ...] = ()
    """Labels of effects that go on with time, as likely as the start of the record that the model takes for them."""

    @property
    def absurd(self) -> bool:
        """Whether a few readings make most of the residual: no noise has such tails."""
        return self.tails > TAILS and not self.rounding

    @property
    def of_thermometers(self) -> bool:
        """Whether what wanders is no more than the errors of the thermometers make in the reading."""
        return self.structured and self.wandering <= OF_THERMOMETER * together(self.thermometers)

    @property
    def unknown(self) -> bool:
        """Whether there is structure whose cause is not known; a few stretches of what rounding makes are none."""
        uneven = bool(self.uneven) and not self.rounding
        return (self.structured and not self.of_thermometers) or uneven or self.absurd


def what_is_left(search: Search, residual: np.ndarray, uneven: Sequence[str] = (), copied: Sequence[str] = ()) -> Left:
    """Describe the noise beside the last base, and the residual of each row; name what is `uneven`, or `copied`."""
    pool, judged = search.pool, search.judged
    loud = _loud(pool)
    theta, counts = judged.base.theta, float(np.median(pool.data.counts))
    innovation = judged.innovation
    total = float(np.average(judged.S(theta), weights=judged.bands.sizes))  # slow parts have not had their time
    wandering = float(np.sqrt(max(total - theta[0], 0.0))) * judged.unit
    floor = float(np.sqrt(innovation * counts)) * judged.unit
    times = pool.spacing * judged.bands.times
    wanders = bool(judged.wanders and not (pool.rows.exact or search.rounded) and wandering > WANDERS * floor)
    filtered = pool.spacing * filter_memory(judged, pool.spacing / pool.record.usual_step()) if wanders else 0.0
    structured = wanders and not filtered
    if filtered:  # all of it is the instrument's
        floor = float(np.sqrt(total * counts)) * judged.unit
    seconds = pool.data.seconds
    in_gaps = float(np.sqrt(pool.felt_in_gaps / pool.data.counts.sum()))
    middle = pool.rows.weighed(np.arange(judged.n) >= judged.n // 2)
    drift = pool.rows.weighed(seconds / max(float(np.ptp(seconds)), 1e-300))
    smallest_drift, smallest_step = judged.smallest(drift, PROVABLE), judged.smallest(middle, PROVABLE)
    own = pool.model.features_.effect_list()
    timed = any(effect.of_time_alone and not isinstance(effect, InitialTransient) for effect in own)
    return Left(
        structured=structured,
        filtered=filtered,
        floor=floor,
        wandering=wandering if structured else 0.0,
        correlation_time=float(np.exp(np.average(np.log(times), weights=theta[1:]))) if structured else 0.0,
        colour=total / innovation,
        uneven=tuple(uneven),
        copied=tuple(copied),
        spikes=_spikes(pool),
        loud=loud,
        in_gaps=in_gaps if in_gaps > WANDERS * floor else 0.0,
        rounding=pool.rounding if search.rounded else 0.0,
        tails=_tails(quiet_rows(residual, pool.record, [(each.start, each.end) for each in loud])),
        thermometers=pool.thermometers if structured else pd.DataFrame(),
        smallest_drift=smallest_drift,
        smallest_step=smallest_step,
        drift_hides=not (timed or pool.rows.exact)
        and smallest_drift > max(DRIFT_TO_STEP * smallest_step, DRIFT_TO_NOISE * floor),
        spectrum=_spectrum(pool, judged),
    )


def _spectrum(pool: Pool, judged: Comparison) -> pd.DataFrame:
    """Means of neighbouring bands, `TO_A_DECADE` of them, in which the power of a few rows would jump about."""
    bands, theta = judged.bands, judged.base.theta
    kept = bands.middle > 0
    frequency = bands.middle[kept] / (2 * np.pi * pool.spacing)
    rows = pd.DataFrame(
        {
            "rows": judged.share,
            "frequency": judged.share * np.maximum(bands.middle, 0.0) / (2 * np.pi * pool.spacing),
            "residual": bands.sums(judged.left(theta) ** 2),
            "noise": judged.share * judged.S(theta),
            "white": judged.share * theta[0],
        }
    )[kept]
    sums = rows.groupby(np.floor(TO_A_DECADE * np.log10(frequency / frequency.min())), sort=True).sum()
    means = sums.drop(columns="rows").div(sums["rows"], axis=0).reset_index(drop=True)
    densities = means[["residual", "noise", "white"]] * (2 * pool.spacing)  # one-sided
    means[["residual", "noise", "white"]] = judged.unit * np.sqrt(densities)
    return means


def _loud(pool: Pool) -> tuple[Loud, ...]:
    """Stretches of rows that are weighted as a burst of noise."""
    data, size = pool.data, 1 / pool.rows.weight
    edges = np.flatnonzero(np.diff(size > BURST, prepend=False, append=False)).reshape(-1, 2)
    found = [
        Loud(
            start=float(data.seconds[low]),
            end=float(data.seconds[high - 1]),
            size=float(size[low:high].max()),
            readings=int(data.counts[low:high].sum()),
        )
        for low, high in edges.tolist()
    ]
    return tuple(sorted(found, key=lambda loud: -loud.size)[:RANKED])


def _tails(residual: np.ndarray) -> float:
    """Rms over the standard deviation of Gaussian noise of which nine tenths are as small; 1 where that is nothing."""
    sizes = residual[np.isfinite(residual)]
    np.abs(sizes, out=sizes)
    whole = rms(sizes)
    usual = float(np.quantile(sizes, 0.9, overwrite_input=True)) / NINE_TENTHS if len(sizes) else 0.0
    return whole / usual if usual > 0 else 1.0


def _spikes(pool: Pool) -> tuple[float, ...]:
    """Times of the readings that were left out, the farthest from the usual one first."""
    rows, record = np.flatnonzero(pool.rows.spikes), pool.record
    usual = CLIPPED, REPEAT, FILLED_IN
    refused = [found for found in record.refused if found.what == "reading" and found.reason not in usual]
    seconds = [*(found.seconds for found in refused), pool.data.seconds[rows]]
    values = np.concatenate([*(found.values for found in refused), pool.data.reading[rows]])
    far = np.argsort(-np.abs(values - np.median(pool.data.reading)))
    return tuple(dict.fromkeys(np.concatenate(seconds)[far].tolist()))[:RANKED]
