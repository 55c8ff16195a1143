"""A stretch of wrong readings: from when, to when, by how much."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sklearn.base import clone

from ..records import Record
from .grids import MOMENT, moment_text, shown, since_start, time_quantiles
from .protocol import SINCE_START, Effect, EffectInfo
from .signals import Signals

_STARTS = (0.2, 0.4, 0.6, 0.8)


class Disturbance(Effect):
    """A short disturbance: readings are off by a constant from `start` to `end`, and right again from then on.

    The stretch's level no longer bends any other coefficient. Readings that are worthless altogether, not merely off,
    are better left out of the fit: ``y.loc[start:end] = numpy.nan``.

    Parameters
    ----------
    start, end : float, time span or date
        The stretch, `end` itself not in it, written as in `Step`.
    removed_by_correct : bool, default True
        Whether `correct` puts the readings of the stretch right. It does by default: a shift that goes away as it came
        is no property of a standard. What was measured might have moved to and fro, though: then pass False.

    Raises
    ------
    ValueError
        By `learn`, for what is no time, a date where the record has none, and an end that is not after the start.
    """

    kind = "disturbance"
    of_time_alone = True
    learned = {"seconds_": "numbers", "moments_": "texts"}
    info = EffectInfo(
        physics="Something disturbed the instrument for a while: a visitor, a draught, a load, a radio, a contact that "
        "came loose and was put right.",
        bench_check="Look in the laboratory's log book at that stretch; repeat what was done then and see the reading "
        "move and come back at constant temperature.",
        formula="disturbance[a, b] = 1 from a to b, else 0",
        parameters={"start": SINCE_START, "end": SINCE_START},
        example={"start": "2 days", "end": "51 h"},
        place=3.36,
    )
    _parameter_constraints = {"start": MOMENT, "end": MOMENT, "removed_by_correct": ["boolean"]}

    def __init__(self, start: Any, end: Any, removed_by_correct: bool = True):
        self.start = start
        self.end = end
        self.removed_by_correct = removed_by_correct

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Four stretches of a fiftieth of the rows; a diagnosis looks at every row and many lengths besides."""
        starts = time_quantiles(record, _STARTS)
        # Length of the stretches among the candidates, as a share of the rows
        ends = time_quantiles(record, [share + 0.02 for share in _STARTS])
        return [cls(float(a), float(b)) for a, b in zip(starts, ends, strict=True) if 0 < a < b]

    def nearby(self, record: Record, share: float = 0.25) -> list[Effect]:
        """Either end moved by `share` of the length, at most by half of it."""
        start, end = self._ends(record)
        reach = min(share, 0.5) * (end - start)
        moved = [("start", start - reach), ("start", start + reach), ("end", end - reach), ("end", end + reach)]
        return [clone(self).set_params(**{name: moment}) for name, moment in moved]

    def _ends(self, record: Record) -> list[float]:
        return [since_start(getattr(self, name), record, name, "Disturbance") for name in ("start", "end")]

    def learn(self, record: Record) -> None:
        """Convert both ends to seconds since the record began, and to dates where there are dates."""
        self._validate_params()
        self.seconds_ = self._ends(record)
        if not self.seconds_[0] < self.seconds_[1]:
            raise ValueError(
                f"The 'end' parameter of Disturbance must lie after its start, {self.start!r}. Got {self.end!r} "
                "instead."
            )
        self.moments_ = [moment_text(seconds, record) for seconds in self.seconds_]

    def names(self) -> list[str]:
        """``disturbance[2024-03-05 00:00:00, 2024-03-05 02:00:00]``."""
        return [f"disturbance[{', '.join(self.moments_)}]"]

    def signals(self, x: Signals) -> Sequence[Any]:
        """1 in the stretch, else 0."""
        start, end = self.seconds_
        return [x.where(x.seconds >= start, 1.0, 0.0) - x.where(x.seconds >= end, 1.0, 0.0)]

    def label(self) -> str:
        """``disturbance: 2024-03-05 00:00:00 to 2024-03-05 02:00:00``."""
        start, end = getattr(self, "moments_", (shown(self.start), shown(self.end)))
        return f"disturbance: {start} to {end}"
