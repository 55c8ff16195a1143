"""Every candidate effect against a rich thermal part, on short averages of the record made white."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..effects.protocol import Effect
from ..records import Record, RecordError
from .blocks import Averages, averaged
from .evidence import Evidence, evidence, own_parts

LEVEL = 0.001
"""Family-wise error probability below which a suspect is named."""
FAIR_SHARE = 0.45
"""Share of the structured variance that the best suspect must explain: the larger of two causes has about half."""
MOST_CAUSES = 3
"""More causes than this, each of them needed, are a sign of wandering noise."""
TIE = 4.0
"""Difference of scores (log likelihood) below which two suspects that explain the same cannot be parted."""
ALIKE = 0.8
"""Squared cosine of what two suspects explain, above which they explain the same."""
RANKED = 10
"""Suspects that are listed."""
REFINED = 4
"""Best suspects whose parameters are refined."""
SHARES = (0.5, 0.25, 0.1, 0.03)
"""Steps of the refinement as shares of a parameter, coarse to fine."""
MOVES = 2
"""Moves of the refinement at each step."""
FEWEST_READINGS = 100
"""A record of fewer averages is too short to judge."""

Key = tuple[str, Any]


@dataclass(frozen=True)
class Suspect:
    """A kind of effect on a column, at its best parameters."""

    effect: Effect
    basis: np.ndarray = field(repr=False)
    score: float
    """Gain in log likelihood, less penalties for the columns and for the parameters tried."""
    judged: Evidence = field(repr=False)
    share: float
    """Share of the structured variance that it explains."""

    @property
    def key(self) -> Key:
        """Kind and column."""
        return key_of(self.effect)

    @property
    def label(self) -> str:
        """``kind`` or ``kind:column``."""
        kind, column = self.key
        return kind if column is None else f"{kind}:{column}"

    @property
    def p_value(self) -> float:
        """Error probability, corrected for the number of candidates tried."""
        return self.judged.family_p(self.basis)

    @property
    def gain_db(self) -> float:
        """Gain on blocks of time that the coefficients were not learned from [dB]."""
        return self.judged.held_out_gain(self.basis)

    def supported(self) -> bool:
        """Whether the evidence is beyond chance and holds on blocks of time that it was not learned from."""
        return self.p_value <= LEVEL and self.gain_db > 0


class Trial:
    """All candidates of a record, and the evidence for each."""

    def __init__(
        self,
        record: Record,
        base: Sequence[Effect],
        own: Sequence[Effect],
        candidates: Sequence[Effect],
        rng: np.random.Generator,
    ):
        self.record, self.candidates, self.rng = record, list(candidates), rng
        for effect in (*base, *own, *candidates):
            effect.learn(record)
        self.data: Averages = averaged(record, [*base, *own, *candidates])
        if len(self.data.reading) < FEWEST_READINGS:
            raise RecordError(
                f"The record is too short to judge: {len(self.data.reading)} readings, and {FEWEST_READINGS} are "
                "needed. Record longer."
            )
        self.base = np.column_stack([self.data.weight, *self.data.columns[: len(base)]])
        self.own = np.column_stack([self.data.weight, *self.data.columns[len(base) : len(base) + len(own)]])
        """Columns of the model's own part."""
        self.columns = self.data.columns[len(base) + len(own) :]
        self.evidence: Evidence = evidence(self.data, self.base, self.columns, rng)
        self._refine()
        self.evidence = evidence(self.data, self.base, self.columns, rng)

    def suspects(self) -> list[Suspect]:
        """The best candidate of each kind and column, best first."""
        sizes = self._grid_sizes()
        best: dict[Key, tuple[float, int]] = {}
        for i, (effect, basis) in enumerate(zip(self.candidates, self.evidence.bases, strict=True)):
            if basis.shape[1]:
                score = self.evidence.score(basis) - float(np.log(sizes[key_of(effect)]))
                best[key_of(effect)] = max(best.get(key_of(effect), (-np.inf, -1)), (score, i))
        return [self.suspect(i, score) for score, i in sorted(best.values(), reverse=True)[:RANKED]]

    def suspect(self, i: int, score: float = 0.0) -> Suspect:
        """Candidate i with its share."""
        return Suspect(self.candidates[i], self.evidence.bases[i], score, self.evidence, self._structured_share(i))

    def _grid_sizes(self) -> dict[Key, float]:
        """Effective number of different candidates of each kind and column: (sum of eigenvalues)^2 / sum of squares."""
        leading: dict[Key, list[np.ndarray]] = {}
        for effect, basis in zip(self.candidates, self.evidence.bases, strict=True):
            if basis.shape[1]:
                leading.setdefault(key_of(effect), []).append(basis[:, -1])
        return {
            key: float(len(vectors) ** 2 / np.sum((np.array(vectors) @ np.array(vectors).T) ** 2))
            for key, vectors in leading.items()
        }

    def _refine(self) -> None:
        """Search around the parameters of the best suspects."""
        for suspect in self.suspects()[:REFINED]:
            effect, gain = suspect.effect, self.evidence.gain(suspect.basis)
            found: np.ndarray | None = None
            for share in (share for share in SHARES for _ in range(MOVES)):
                near = effect.nearby(self.record, share)
                for other in near:
                    other.learn(self.record)
                if not near:
                    break
                tried = averaged(self.record, near, weight=self.data.weight).columns
                gains = [self.evidence.gain(self.evidence.basis(columns)) for columns in tried]
                if max(gains) > gain:
                    which = int(np.argmax(gains))
                    effect, gain, found = near[which], gains[which], tried[which]
            if found is not None:
                self.candidates.append(effect)
                self.columns.append(found)

    def causes(self, most: int = MOST_CAUSES + 1) -> tuple[int, bool]:
        """How many causes the record shows, and whether wandering noise is left after them.

        Candidates are added one after the other as long as each is supported by what the earlier ones left. One cause
        needs one candidate, two causes need two; wandering noise takes ever more, and never quite goes away.
        """
        judged = self.evidence
        for count in range(most):
            scores = [judged.score(basis) if basis.shape[1] else -np.inf for basis in judged.bases]
            best = judged.bases[int(np.argmax(scores))]
            if best.shape[1] == 0 or judged.family_p(best) > LEVEL:
                return count, judged.wanders(self.rng)
            space = np.column_stack((judged.space, best))
            bases = own_parts(judged.bases, best)
            judged = replace(judged, space=space, bases=bases)
        return most, judged.wanders(self.rng)

    def explained(self, columns: np.ndarray) -> float:
        """Sum of squares of the averages that columns explain beside the rich thermal part."""
        more = np.column_stack((self.base, columns))
        return self._left - residual_sum_of_squares(more, self.data.reading)

    @cached_property
    def _left(self) -> float:
        """Sum of squares that the rich thermal part leaves."""
        return residual_sum_of_squares(self.base, self.data.reading)

    def _structured_share(self, i: int) -> float:
        """Share of the structured variance (base residual less white noise) that candidate i explains."""
        structured = self._left - len(self.base) * self.evidence.noise.innovation_variance
        return float(np.clip(self.explained(self.columns[i]) / max(structured, 1e-300), 0.0, 1.0))

    @property
    def floor(self) -> float:
        """Standard deviation of one sample that no effect can explain, in the unit of y."""
        return float(np.sqrt(self.evidence.noise.innovation_variance * np.median(self.data.counts)))


def key_of(effect: Effect) -> Key:
    """Kind and column of an effect."""
    inputs = effect.inputs()
    return effect.kind, inputs[0] if inputs else None


def tied(best: Suspect, other: Suspect) -> bool:
    """Whether another suspect is as good as the best one, or nearly as good by explaining the same."""
    if best.judged is not other.judged:
        return False
    behind = best.score - other.score
    return behind < TIE or (behind < 2 * TIE and best.judged.alike(best.basis, other.basis) > ALIKE)


def residual_sum_of_squares(columns: np.ndarray, reading: np.ndarray) -> float:
    """What least squares leaves."""
    return float(np.sum((reading - columns @ np.linalg.lstsq(columns, reading, rcond=1e-10)[0]) ** 2))
