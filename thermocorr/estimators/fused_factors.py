"""Factors of a fused sweep: of all rows at once, and of each stretch when somebody asks for it.

A fit needs the factor of all rows alone; standard errors need those of the stretches, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import NamedTuple, overload

import numpy as np

from ..equations import TriangularFactor
from ..equations.bordered import BorderedFactor
from ..equations.leastsquares import WIDE
from ..equations.preconditioned import Crossed


class _OfSegment(NamedTuple):
    """What one segment has given to a stretch."""

    columns: list[int]
    """Where the columns of the cross products stand in ``[1 | Q | U]``; those before the first are hidden."""
    n_hidden: int
    """Leading columns whose share in the others is left out."""
    crossed: list[Crossed]

    def factors(self) -> list[tuple[list[int], np.ndarray]]:
        """Matrices and their columns: the sums of the matrices' cross products are those of the rows."""
        made = [crossed.factor() for crossed in self.crossed]
        if self.n_hidden:  # what the decays can explain is left out
            n_columns = self.n_hidden + len(self.columns)
            wide = _stacked(n_columns, [(range(n_columns)[-factor.shape[1] :], factor) for factor in made])
            made = [TriangularFactor(n_columns).update(wide).behind(self.n_hidden).r]
        return [(self.columns[len(self.columns) - factor.shape[1] :], factor) for factor in made]


class FusedFactors(Sequence[TriangularFactor]):
    """Factors of ``[1 | Q | U]``, one for each stretch, made of cross products when they are asked for.

    Parameters
    ----------
    width : int
        Columns of ``[1 | Q | U]``.
    n_stretches : int
    shared : sequence of int
        Numbers of the columns that all segments share.
    """

    def __init__(self, width: int, n_stretches: int, shared: Sequence[int]):
        self.width, self._shared = width, shared
        self.n_rows = [0] * n_stretches
        """Rows with a reading in each stretch."""
        self._of_stretches: list[list[_OfSegment]] = [[] for _ in range(n_stretches)]
        self._of_all: list[tuple[list[int], np.ndarray]] | None = []
        self._made: list[TriangularFactor] | None = None
        self._segments: list[_OfSegment] = []

    def add(self, columns: list[int], n_hidden: int, gathered: Sequence[tuple[int, Crossed]]) -> None:
        """Take in cross products of one segment, with the number of the stretch that each belongs to, in time order."""
        for stretch, some in groupby(gathered, key=lambda one: one[0]):
            self._of_stretches[stretch].append(_OfSegment(columns, n_hidden, list(_joined(c for _, c in some))))
        if n_hidden or self.width > WIDE:  # left out in each stretch apart; or decays of runs, which hardly meet
            self._of_all = None
            self._segments.append(_OfSegment(columns, n_hidden, list(_joined(c for _, c in gathered))))
        elif self._of_all is not None:
            self._of_all += _OfSegment(columns, 0, list(_joined(c for _, c in gathered))).factors()

    def total(self) -> TriangularFactor | None:
        """Factor of all rows; None where only those of the stretches tell."""
        if self._of_all is None:
            return None
        return TriangularFactor.standing_for(_stacked(self.width, self._of_all), sum(self.n_rows))

    def bordered(self) -> BorderedFactor | None:
        """What many segments say of decays of their own and of the columns they share; None where all are one."""
        if self._of_all is not None or any(each.n_hidden for each in self._segments):
            return None
        segments = []
        for columns, _, crossed in self._segments:
            factors = [each.factor() for each in crossed]
            places = [range(len(columns))[-factor.shape[1] :] for factor in factors]
            matrix = _stacked(len(columns), list(zip(places, factors, strict=True)))
            segments.append((columns[: len(columns) - len(self._shared)], matrix))
        self._segments = []
        return BorderedFactor.of(self._shared, segments, sum(self.n_rows))

    def __len__(self) -> int:
        return len(self.n_rows)

    @overload
    def __getitem__(self, which: int) -> TriangularFactor: ...
    @overload
    def __getitem__(self, which: slice) -> list[TriangularFactor]: ...
    def __getitem__(self, which: int | slice) -> TriangularFactor | list[TriangularFactor]:
        if self._made is None:
            parts = [[pair for part in parts for pair in part.factors()] for parts in self._of_stretches]
            stacked = [_stacked(self.width, pairs) for pairs in parts]
            self._made = [TriangularFactor.standing_for(m, n) for m, n in zip(stacked, self.n_rows, strict=True)]
            self._of_stretches = []
        return self._made[which]


def _stacked(n_columns: int, parts: Sequence[tuple[Sequence[int], np.ndarray]]) -> np.ndarray:
    """Matrices, each of some of the columns, one above the other."""
    rows, at = np.zeros((sum(len(part) for _, part in parts), n_columns), order="F"), 0
    for columns, part in parts:
        rows[at : at + len(part), columns] = part
        at += len(part)
    return rows


def _joined(parts: Iterable[Crossed]) -> Iterator[Crossed]:
    """Cross products in the coordinates of one triangle are added up."""
    for _, alike in groupby(parts, key=lambda part: id(part.triangle)):
        first, *others = alike
        products = [part.product for part in (first, *others) if part.product is not None]
        yield first._replace(product=sum(products[1:], products[0])) if products else first
