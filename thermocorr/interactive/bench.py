"""The workbench itself: a log, a history of steps, and for each arrangement its model, errors and diagnosis."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from sklearn.base import clone

from ..effects import ThermalLag
from ..effects.protocol import Effect
from ..estimators import DynamicBiasRegressor
from ..estimators.advice import Advice, advise
from ..estimators.variants import variants_of
from ..files.codec import fields, integer, number, text
from ..files.effect_nodes import EffectCodec, import_path
from ..judgement import diagnose
from ..judgement.refine import with_fitted_causes, with_missing
from ..pages import PageData, figures
from ..pages.charts import Chart
from .acts import (
    ROLES,
    Act,
    Add,
    AddedEffect,
    Arrangement,
    Columns,
    LeaveOut,
    ModelSettings,
    Past,
    Roles,
    Stretch,
    folded,
    roles_of,
    shape_of,
)
from .learning import Fitted, axis_of, chosen_lags, fitted, moment_words, preview_of, quietly, sentence, unfitted
from .source import ReadLog
from .tiles import Store

Chore = tuple[str, Callable[[], None]]


class Bench:
    """One log under work. Everything is done by `perform` and, in between, by `next_chore`.

    `source` (Source). `store` (Store): Where curves are put. `roles` (Roles, optional): None asks the user.
    `settings` (Settings). `own` (sequence of classes of effects): Suspects of the user's own. `own_file` (str): The
    file that they are from. `base` (DynamicBiasRegressor, optional): The model whose settings count where
    `ModelSettings` has none.
    """

    def __init__(
        self,
        source: ReadLog,
        store: Store,
        *,
        roles: Roles | None = None,
        settings: ModelSettings | None = None,
        own: Sequence[type[Effect]] = (),
        own_file: str = "",
        base: DynamicBiasRegressor | None = None,
    ):
        self.source, self.store, self.own, self.own_file = source, store, tuple(own), own_file
        self.base = base
        self.settings = settings or ModelSettings()
        self.codec = EffectCodec([import_path(cls, cls.__name__) for cls in self.own])
        self.past = Past(((Columns(roles),) if roles else (),), 0)
        self.needed: frozenset[str] = frozenset()
        """Curves in the store that are another's, and stay."""
        self.problem = ""
        """Why there is no model."""
        self.advised: dict[str, Advice | None] = {}
        """Which correction is advised, by the key of the arrangement that was asked about; None where that failed."""
        self.kept: OrderedDict[str, Fitted] = OrderedDict()
        """Fitted arrangements by their keys, the one that was looked at last behind the others."""
        self._known: dict[str, dict[str, Any]] = {}

    # ------------------------------------------------------------------------------------------------------- the state

    @property
    def acts(self) -> tuple[Act, ...]:
        """The steps that stand."""
        return self.past.acts

    def arrangement(self, count: int | None = None) -> Arrangement:
        """Arrangement now, or after the first steps."""
        return folded(self.acts[:count], self.settings)

    @property
    def current(self) -> Fitted | None:
        """The fitted arrangement; None where there is none."""
        return self.kept.get(self.arrangement().key())

    def known(self, key: str) -> dict[str, Any]:
        """Errors of an arrangement, known after its model has gone: rms, held_out, later, moment, verdict.

        later: rms error on later stretches behind each moment that was asked about, see `moment`.
        """
        return self._known.setdefault(key, {})

    @property
    def moment(self) -> float | None:
        """Share of the record before the last date in the models of all steps, behind which their errors compare."""
        moments = [self.known(self.arrangement(n).key()).get("moment") for n in range(1, len(self.acts) + 1)]
        return max((moment for moment in moments if moment is not None), default=None)

    def fit(self, arrangement: Arrangement | None = None) -> Fitted:
        """The fitted arrangement, by default what stands on the bench; kept, or fitted anew."""
        arrangement = arrangement or self.arrangement()
        key = arrangement.key()
        if key not in self.kept:
            found = fitted(self.source, arrangement, self.codec, self.store, self.base)
            self.known(key)["rms"] = _rms(self.store, found)
            self.kept[key] = found
        self.kept.move_to_end(key)
        self._forget(key)
        return self.kept[key]

    def _forget(self, needed: str) -> None:
        # Fitted arrangements that are kept; others are fitted again when they are asked for, to the same bits
        # Rows of all of them together, from which fewer are kept
        most = max(3, min(12, 3_000_000 // max(len(self.source.frame), 1)))
        for key in list(self.kept):
            if len(self.kept) <= most:
                break
            if key not in (needed, self.arrangement().key()):
                del self.kept[key]
        self.store.keep(self.needed.union(*(found.curves.values() for found in self.kept.values())))

    # ----------------------------------------------------------------------------------------------------- what is done

    def start(self) -> None:
        """Fit what the log was opened with; where that cannot be, `problem` says why."""
        try:
            self.problem = ""
            self.fit()
        except Exception as error:  # effects of the user's own raise whatever they like
            self.problem = sentence(error)

    def perform(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Do what is asked; nothing has changed where it raises.

        `asked` (dict): ``do``: columns, shape, add, leave_out, undo, redo, drop, judge, preview or fit; with what these
        need. Raises ValueError for what cannot be done: its sentence is for the user.
        """
        doers = {
            "columns": self._columns, "shape": self._shape, "add": self._add, "leave_out": self._leave_out,
            "undo": self._undo,
            "redo": self._redo, "drop": self._drop, "judge": self._judge, "preview": self._preview, "fit": self._fit,
        }  # fmt: skip
        name = text(asked.get("do"), "do")
        if name not in doers:
            raise ValueError(f"{name!r} cannot be done here.")
        return doers[name](asked) or {}

    def _become(self, acts: tuple[Act, ...]) -> None:
        """Fit these steps and let them stand; steps that were undone before are forgotten."""
        self.fit(folded(acts, self.settings))
        self.past, self.problem = self.past.followed_by(acts), ""

    def _columns(self, asked: dict[str, Any]) -> None:
        roles = roles_of(fields(asked, "columns", ("do", *ROLES, "ignored")), "columns")
        roles.check(self.source.frame.columns)
        others = [act for act in self.acts if not isinstance(act, Columns)]
        self._become((Columns(roles), *others))

    def _shape(self, asked: dict[str, Any]) -> None:
        asked = fields(asked, "model", ("do", "time_constants", "degree", "products"))
        given = asked["time_constants"]
        if isinstance(given, str):
            given = chosen_lags(given)
        self._become((*self.acts, shape_of({**asked, "time_constants": given}, "model")))

    def suspect(self, asked: dict[str, Any]) -> Effect:
        """The effect of a suspect, or of one that cannot be told apart from it."""
        found = self.current.diagnosis if self.current else None
        listed = found.suspects if found else ()
        place = integer(asked.get("suspect"), "suspect", 0, 10**6)
        if place >= len(listed):
            raise ValueError("This suspect is no longer on the list: the model has changed.")
        alike = asked.get("alike")
        if alike is None:
            return listed[place].effect
        others, which = listed[place].confusable_with, integer(alike, "alike", 0, 10**6)
        if which >= len(others):
            raise ValueError("This suspect is no longer on the list: the model has changed.")
        return others[which]

    def _add(self, asked: dict[str, Any]) -> None:
        effect, found = self.suspect(asked), self.current
        assert found is not None  # it has suspects
        added = AddedEffect.of(self.codec.pack(clone(effect), "effect"), effect.label())
        lags: tuple[float, ...] = ()
        if isinstance(effect, ThermalLag) and len(found.model.time_constants_):
            lags = tuple(with_missing(found.model, effect).time_constants)
        self._become((*self.acts, Add(added, lags)))

    def _leave_out(self, asked: dict[str, Any]) -> None:
        asked, found = fields(asked, "leave_out", ("do", "low", "high")), self.current
        if found is None:
            raise ValueError("There is no model yet: say first which column is the temperature and which the reading.")
        axis = axis_of(found)
        low, high = (number(asked[end], end) * axis.scale - axis.zero for end in ("low", "high"))
        place = self.store.get(found.curves["place"])
        places = np.arange(int(np.searchsorted(place, low, "left")), int(np.searchsorted(place, high, "right")))
        if not len(places):
            raise ValueError("There are no rows in this stretch.")
        rows, ends = np.sort(self.store.get(found.curves["row"])[places].astype(int)), places[[0, -1]]
        if not np.isfinite(np.delete(found.data.learned.to_numpy(float), rows)).any():
            raise ValueError("This stretch holds all readings that are learned from: leave a part of them in.")
        where = moment_words(found, ends, self.store.get(found.curves["seconds"])[ends])
        self._become((*self.acts, LeaveOut(_stretches(rows), where)))

    def _undo(self, asked: dict[str, Any]) -> None:
        self._go(self.past.at - 1, "There is nothing to undo.")

    def _redo(self, asked: dict[str, Any]) -> None:
        self._go(self.past.at + 1, "There is nothing to do again.")

    def _go(self, to: int, refusal: str) -> None:
        if not 0 <= to < len(self.past.versions):
            raise ValueError(refusal)
        past = Past(self.past.versions, to)
        if folded(past.acts, self.settings).roles is not None:
            self.fit(folded(past.acts, self.settings))
        self.past = past
        self.start()

    def _drop(self, asked: dict[str, Any]) -> None:
        step = integer(asked.get("step"), "step", 0, 10**6)
        if step >= len(self.acts):
            raise ValueError("This step is no longer there.")
        if isinstance(self.acts[step], Columns):
            raise ValueError("The first step says what the columns are: change it at the left.")
        self._become((*self.acts[:step], *self.acts[step + 1 :]))

    def _judge(self, asked: dict[str, Any]) -> None:
        if self.current is not None:
            self.current.said.clear()

    def _fit(self, asked: dict[str, Any]) -> None:
        """Make sure that the curves of a step are there."""
        step = integer(asked.get("step"), "step", 0, len(self.acts))
        self.fit(self.arrangement(step))

    def _preview(self, asked: dict[str, Any]) -> dict[str, Any]:
        effect, found = self.suspect(asked), self.current
        assert found is not None  # it has suspects
        shown: dict[str, Any] = quietly(lambda: preview_of(found, effect, self.store))
        return shown

    # --------------------------------------------------------------------------------------------- what is not urgent

    def next_chore(self) -> Chore | None:
        """The next thing to find out about what stands on the bench: a few words, and what does it."""
        found = self.current
        if found is None:
            return None
        chores: list[Chore | None] = [
            None if len(self.acts) > 1 or found.arrangement.key() in self.advised else
            ("which correction to use", lambda: self._advise(found)),
            None if found.diagnosis or "diagnosis" in found.said else
            ("looking for what is missing", lambda: self._diagnose(found)),
            None if found.charts is not None else ("drawing", lambda: self._draw(found)),
        ]  # fmt: skip
        return next(filter(None, chores), None) or self._missing_errors()

    def _advise(self, found: Fitted) -> None:
        """Advise a correction; where the user has chosen no settings and gone no further, begin with it."""
        X, y, model = (
            found.data.X,
            found.data.learned,
            unfitted(self.source, found.arrangement, self.codec, self.base or DynamicBiasRegressor()),
        )
        variants = variants_of(model, max(model.degree, 2))
        try:
            advice = quietly(lambda: advise({name: each.fit(X, y) for name, each in variants.items()}, X, y))
        except Exception:  # effects of the user's own raise whatever they like
            self.advised[found.arrangement.key()] = None
            return
        if self.base is None and self.settings.open and advice.variant:
            lags = () if advice.choice == "static" else self.settings.time_constants
            self.settings = replace(self.settings, time_constants=lags, degree=variants[advice.variant].degree)
            self.fit()
        self.advised[self.arrangement().key()] = advice

    def _missing_errors(self) -> Chore | None:
        """Errors of steps that are not known yet: never on the bench as they stand, or not behind the last date."""
        for count in range(1, len(self.acts) + 1):
            arrangement = self.arrangement(count)
            known = self.known(arrangement.key())
            lacks = "no errors" not in known and self.moment not in known.get("later", {})
            if arrangement.roles is not None and lacks:
                return f"measuring the error after step {count}", partial(self._measure_step, arrangement)
        return None

    def _measure_step(self, arrangement: Arrangement) -> None:
        try:
            found = self.fit(arrangement)
        except Exception as error:  # see below
            self.known(arrangement.key())["no errors"] = sentence(error)
            return
        if found.diagnosis is None:
            self._diagnose(found)
        if found.diagnosis is not None and found.diagnosis.ahead is not None:
            self.known(arrangement.key())["later"][self.moment] = found.diagnosis.ahead.later_rms(self.moment)

    def _diagnose(self, found: Fitted) -> None:
        X, y, known = found.data.X, found.data.learned, self.known(found.arrangement.key())
        try:
            judged = quietly(lambda: diagnose(found.model, X, y, suspects=self.own))
            found.diagnosis = judged = quietly(lambda: with_fitted_causes(judged, found.model, X, y))
            assert judged.ahead is not None
            known |= {"verdict": judged.verdict, "held_out": judged.held_out_rms, "moment": judged.moment}
            known.setdefault("later", {})[judged.moment] = judged.ahead.later_rms(judged.moment)
        except Exception as error:  # effects of the user's own raise whatever they like
            found.said["diagnosis"] = known["no errors"] = sentence(error)

    def _draw(self, found: Fitted) -> None:
        """Charts of the report page that belong to the model."""
        found.charts = []
        try:
            data = quietly(lambda: PageData.of(found.model, found.data.X, found.data.y))
            charts: list[Chart | None] = [figures.stability(data), figures.following(data)]
        except Exception as error:  # see above
            found.said["charts"] = sentence(error)
            return
        found.charts = [{**chart.payload(), "caption": chart.caption} for chart in charts if chart is not None]


def _rms(store: Store, found: Fitted) -> float:
    """Rms residual of the rows that were learned from."""
    learned = found.data.learned.to_numpy(float)[store.get(found.curves["row"]).astype(int)]
    residual = store.get(found.curves["residual"])
    known = residual[np.isfinite(residual) & np.isfinite(learned)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def _stretches(rows: np.ndarray) -> tuple[Stretch, ...]:
    """Sorted rows as stretches without gaps."""
    cuts = np.flatnonzero(np.diff(rows) != 1) + 1
    return tuple((int(part[0]), int(part[-1]) + 1) for part in np.split(rows, cuts))
