"""A record, its steps and errors, for any screen."""

from __future__ import annotations

import hashlib
import json
import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects import ThermalLag
from ..effects.protocol import Effect
from ..judgement import Diagnosis, diagnose
from ..judgement.diagnose import out_of_sample
from ..judgement.refine import with_fitted_causes, with_missing
from ..judgement.where import first_look
from ..model import DynamicBiasRegressor
from ..model.advice import NEEDLESS, Advice, advise, needless_rms
from ..model.averages import rms
from ..model.out_of_sample import OutOfSample
from ..model.thermometers import Thermometers
from ..model.variants import variants_of
from ..output.axes import Display
from ..output.curves import N_CELLS, Curves
from ..output.diagnosis_displays import ErrorsDisplay, SuspectsDisplay, WhereDisplay
from ..output.effect_nodes import EffectCodec, import_path
from ..output.model_displays import ContributionsDisplay
from ..output.residual_displays import AgainstDisplay, AllanDisplay, ResidualsDisplay
from ..output.words import effect_text
from ..readers import Options, guess, is_counter
from ..records import RecordError
from ..records.errors import listing, noted, quoted
from ..records.numbers import as_pandas
from ..records.types import kind_of
from .files import exported, script
from .log import Log, effects_in, quiet

ROLES = ("reading", "temperature", "reference", "time", "run")
"""What a column may be; else it is ignored, or a suspect."""
Chore = tuple[str, Callable[[], None]]
Act = dict[str, Any]
"""What the user did, as JSON: ``do`` (roles, shape, add or leave_out), ``text``, and what that needs."""
PICTURES = ("errors", "time", "against", "where", "suspects", "contributions", "allan")


@dataclass
class Step:
    """A fitted model, and what is known of it."""

    key: str
    """A name that only equal steps share."""
    model: DynamicBiasRegressor
    X: pd.DataFrame
    y: pd.Series
    learned: pd.Series
    """Readings that are learned from; NaN in stretches that are left out."""
    left_out: list[tuple[int, int]]
    """First row of each stretch that is left out, and the one behind its last."""
    said: tuple[str, ...]
    """How the log was read."""
    notes: tuple[str, ...]
    curves: Curves
    where: pd.DataFrame | None = None
    """Where it fails, before it is judged."""
    diagnosis: Diagnosis | None = None
    lacking: str = ""
    """Why there is no diagnosis."""
    previewed: tuple[str, Curves] | None = None
    """The suspect that was looked at last, and the model with it."""


class Story:
    """A record and its models, for any screen.

    Parameters
    ----------
    log : DataFrame or Log
        Readings, temperature, and whatever else was recorded.
    roles : dict, optional
        Column of each of ``temperature``, ``reading``, ``reference``, ``time``, ``run``, and the list ``ignored``; what
        is not said is guessed, and `roles` is None where a person must say it, see `assign`.
    model : DynamicBiasRegressor, optional
        Unfitted or not; it stays as it is. Its settings are kept; without it, what is advised is begun with.
    suspects : sequence of classes of effects
        Suspects of your own.

    Examples
    --------
    >>> from thermocorr.datasets import make_record
    >>> from thermocorr.workbench import Story
    >>> story = Story(make_record(2000, effects={"step": 2.0}, seed=1))
    >>> story.begin()
    >>> story.judge().verdict
    'missing'
    >>> story.add(0)
    >>> story.judge().verdict
    'nothing missing'
    >>> before, after = story.errors()["error"].iloc[-2:]
    >>> bool(after < 0.9 * before)
    True
    """

    def __init__(
        self,
        log: Log | pd.DataFrame,
        *,
        roles: dict[str, Any] | None = None,
        model: DynamicBiasRegressor | None = None,
        suspects: Sequence[type[Effect]] = (),
        effects_file: str = "",
        settled: bool | None = None,
    ):
        self.log = log if isinstance(log, Log) else Log(frame=log.rename(columns=str), name="data in memory")
        self.base = clone(DynamicBiasRegressor() if model is None else model)
        self.settled = model is not None if settled is None else settled
        self.own, self.effects_file = tuple(suspects), effects_file
        self.codec = EffectCodec([import_path(cls, cls.__name__) for cls in self.own])
        found = _guessed(self.log.frame, roles or {})
        first: Act | None = None if found is None else _roles_act(found)
        self.versions: list[list[Act]] = [[] if first is None else [first]]
        """All rows of acts that ever stood; undo and redo go through them."""
        self.at = 0
        self.problem = ""
        """Why there is no model."""
        self.advice: dict[str, Advice | None] = {}
        """Which correction is advised, by the key of the step that was asked about; None where that failed."""
        self.progress: Callable[[str], None] = lambda text: None
        """Called with what is being tried."""
        self._steps: OrderedDict[str, Step] = OrderedDict()
        self._laws: dict[str, dict[str, OutOfSample]] = {}
        """Corrections of a record with runs, with their errors, by the key of the first step."""
        self._known: dict[str, dict[str, Any]] = {}

    @classmethod
    def open(
        cls,
        paths: Sequence[str | Path] = (),
        how: Options | None = None,
        *,
        names: Sequence[str] = (),
        effects_file: str = "",
        **given: Any,
    ) -> Story:
        """Open a log in files; without one, the built-in record.

        Parameters
        ----------
        paths : sequence of paths
            Files of the log.
        how : Options, optional
            What is said of them, see `read_log`.
        names : sequence of str
            What the files are called where they came from, if that is not here.
        effects_file : str
            Python file with effects of your own, to be suspects too.
        **given
            As for `Story`.

        Raises
        ------
        RecordError
            For files that cannot be read.
        """
        own = effects_in(effects_file) if effects_file else ()
        log = Log.opened(paths, how, names) if paths else Log.built_in()
        return cls(log, suspects=own, effects_file=effects_file, **given)

    @classmethod
    def of(cls, model: DynamicBiasRegressor, X: Any, y: Any, *, suspects: Sequence[type[Effect]] = ()) -> Story:
        """Open a DataFrame with a model; TypeError for other data.

        The model may be fitted or not; names of columns are needed.
        """
        frame = as_pandas(X)
        if not isinstance(frame, pd.DataFrame):
            raise TypeError(f"The workbench needs a DataFrame, whose columns have names. Got {type(X).__name__}.")
        attrs, index = dict(frame.attrs), frame.index
        frame, name = frame.rename(columns=str), str(getattr(y, "name", None) or "reading")
        name = name if name not in frame.columns else f"{name} (reading)"
        frame = frame.assign(**{name: pd.Series(getattr(y, "to_numpy", lambda: y)(), index=index)})
        frame.attrs = {**attrs, "units": {**attrs.get("units", {}), **getattr(y, "attrs", {}).get("units", {})}}
        ambient = Thermometers.of(model.temperature).ambient
        known = {"temperature": frame.columns[0] if ambient is None else ambient, "reading": name}
        known |= {role: getattr(model, role) for role in ("reference", "time", "run")}
        roles = {role: None if column is None else str(column) for role, column in known.items()}
        return cls(Log(frame=frame, name="data in memory"), roles=roles, model=model, suspects=suspects)

    # ------------------------------------------------------------------------------------------------------ what stands

    @property
    def acts(self) -> list[Act]:
        """What the user did, as it stands."""
        return self.versions[self.at]

    @property
    def roles(self) -> dict[str, Any] | None:
        """Column of each role, and those ignored; or None."""
        return next((act["roles"] for act in self.acts if act["do"] == "roles"), None)

    @property
    def now(self) -> Step | None:
        """The step that stands; None where there is no model."""
        return self._steps.get(self.key())

    def key(self, acts: Sequence[Act] | None = None) -> str:
        """The name of a step."""
        said = json.dumps(self.acts if acts is None else list(acts), sort_keys=True)
        return hashlib.sha256(said.encode()).hexdigest()[:24]

    def known(self, acts: Sequence[Act] | None = None) -> dict[str, Any]:
        """Known errors of a step: rms, held_out, later, verdict.

        later: rms error on later stretches behind each moment that was asked about, see `moment`.
        """
        return self._known.setdefault(self.key(acts), {})

    @property
    def moment(self) -> float | None:
        """Last dated share of all steps, where errors compare.

        Share of the record before the last date in any step; None without dates.
        """
        moments = [self.known(self.acts[:n]).get("moment") for n in range(1, len(self.acts) + 1)]
        return max((moment for moment in moments if moment is not None), default=None)

    def errors(self) -> pd.DataFrame:
        """Rms errors on later data of each correction and step.

        Columns: step (name), error (NaN where it is not known yet, or cannot be compared), act (its number; NaN).
        """
        rows: list[tuple[str, float, float]] = []
        advice, moment = self.advice.get(self.key(self.acts[:1])), self.moment
        laws = self._laws.get(self.key(self.acts[:1]), {})
        if laws:  # levels of runs, which the advice leaves out, are in the errors of steps
            none = needless_rms(next(iter(laws.values())), moment)
            others = {name: law.later_rms(moment) for name, law in laws.items()}
        elif advice is not None and not advice.table.empty and moment is None:
            none, others = (
                advice.before,
                {str(k): float(v) for k, v in advice.table["all"].items() if k not in NEEDLESS},
            )
        else:
            none, others = math.nan, {}
        rows += [("no correction", none, math.nan)] if others else []
        for kind in ("static", "dynamic"):
            name = min((name for name in others if name.startswith(kind)), key=others.__getitem__, default="")
            if name and advice is not None and not advice.variant.startswith(kind):
                rows.append((f"{name} correction", others[name], math.nan))
        for number, act in enumerate(self.acts):
            error = self.known(self.acts[: number + 1]).get("later", {}).get(moment, math.nan)
            compared = _left_out(self.acts[: number + 1]) == _left_out(self.acts)
            name = f"+ {act['text']}" if number else "the model"
            if number == 0 and advice is not None and advice.variant and act["begun"]:
                name = f"{advice.variant} correction"
            rows.append((name, error if compared else math.nan, number))
        return pd.DataFrame(rows, columns=["step", "error", "act"])

    # ----------------------------------------------------------------------------------------------------- what is done

    def begin(self) -> None:
        """Fit, and begin with the advised correction.

        `problem` says why there is no model.
        """
        self.start()
        if self.now is not None:
            self._advise()

    def start(self) -> None:
        """Fit what stands; where that cannot be, `problem` says why."""
        try:
            self.problem = ""
            self.fit()
        except Exception as error:  # effects of the user's own raise whatever they like
            self.problem = sentence(error)

    def assign(self, **roles: Any) -> None:
        """Say what the columns are: ``temperature``, ``reading``, ``reference``, ``time``, ``run``, ``ignored``.

        Raises RecordError for columns that are not there, or are two things at once.
        """
        given = {**dict.fromkeys(ROLES), "ignored": [], **roles}
        _check_roles(given, list(self.log.frame.columns))
        first, others = self.acts[:1], self.acts[1:]
        begun = first[0]["begun"] if others else {}
        self._become([{**_roles_act(given), "begun": begun}, *others])

    def shape(self, time_constants: Any = 6, degree: Any = 2, products: Any = False) -> None:
        """Give the model other settings; ValueError for what there is not.

        `time_constants` may be typed: "6", "auto", "none", "60, 15min, 2h".
        """
        taus = chosen_lags(time_constants) if isinstance(time_constants, str) else time_constants
        if not isinstance(taus, int | str) and not all(isinstance(tau, int | float | str) for tau in taus):
            raise ValueError("Time constants are a number of them, or a list of spans, such as 60, 15min, 2h.")
        degree = _integer(degree, "The degree", 0, 9)
        if products not in (False, True, 2, 3):
            raise ValueError(f"Products are of two lags, or of two and three: False, 2 or 3. Got {products!r:.40}.")
        lags = f"{taus} time constants" if isinstance(taus, int) else f"time constants {taus or 'none'}"
        of = {0: "", 1: ", products of lags", 2: ", products of lags", 3: ", products of two and three lags"}
        params = {"time_constants": taus, "degree": degree, "products": products}
        self._become([*self.acts, {"do": "shape", "text": f"{lags}, degree {degree}{of[int(products)]}", **params}])

    def suspect(self, place: Any, alike: Any = None) -> Effect:
        """The effect of a suspect, or of its rival.

        Raises ValueError for one that is not listed.
        """
        listed = self.now.diagnosis.suspects if self.now is not None and self.now.diagnosis is not None else ()
        gone = "This suspect is no longer on the list: the model has changed."
        found = listed[_integer(place, gone, 0, len(listed) - 1)]
        if alike is None:
            return found.effect
        return found.confusable_with[_integer(alike, gone, 0, len(found.confusable_with) - 1)]

    def add(self, place: Any = 0, alike: Any = None) -> None:
        """Add a suspect to the model, or its rival."""
        effect, found = self.suspect(place, alike), self.now
        assert found is not None  # it has suspects
        node = self.codec.pack(clone(effect), "effect")
        act: Act = {"do": "add", "text": effect.label(), "effect": node, "time_constants": []}
        if isinstance(effect, ThermalLag) and len(found.model.time_constants_):
            act["time_constants"] = list(with_missing(found.model, effect).time_constants)
        self._become([*self.acts, act])

    def preview(self, place: Any, alike: Any = None) -> dict[str, Any]:
        """What a suspect would leave, its time constants held.

        Returns dict: label, before and after (rms of the readings that are learned from). `picture` shows it.
        """
        effect, found = self.suspect(place, alike), self.now
        assert found is not None  # it has suspects
        model = with_missing(found.model, effect)
        if not isinstance(effect, ThermalLag):
            model.set_params(time_constants=found.model._fixed_time_constants())
        with quiet():
            model.set_params(alpha=found.model.alpha_).fit(found.X, found.learned)
            curves = Curves(model, found.X, found.y, keep=True)
        found.previewed = (effect_text(effect), curves)
        residuals = [_learned(found, curves_) for curves_ in (found.curves, curves)]
        both = np.isfinite(residuals).all(axis=0)
        before, after = (rms(residual[both]) for residual in residuals)
        return {"label": effect.label(), "before": before, "after": after}

    def leave_out(self, low: Any, high: Any) -> None:
        """Stop learning from rows between two places [s].

        Raises ValueError where no reading would be left to learn from.
        """
        found = self.now
        if found is None:
            raise ValueError("There is no model yet: say first which column is the temperature and which the reading.")
        low, high = (_number(end, "The end of a stretch") for end in (low, high))
        parts = list(found.curves.parts())
        places = np.concatenate([found.curves.places(part) for part in parts])
        row = np.concatenate([np.arange(len(found.y))[part.rows] for part in parts])
        inside = row[(places >= low) & (places <= high)]
        if not len(inside):
            raise ValueError("There are no rows in this stretch.")
        rows, times = np.sort(inside), found.curves.record.times
        if not np.isfinite(np.delete(found.learned.to_numpy(float), rows)).any():
            raise ValueError("This stretch holds all readings that are learned from: leave a part of them in.")
        cuts = np.flatnonzero(np.diff(rows) != 1) + 1
        stretches = [[int(part[0]), int(part[-1]) + 1] for part in np.split(rows, cuts)]
        where = " to ".join(times.label(int(inside[end])) for end in (0, -1))
        self._become([*self.acts, {"do": "leave_out", "text": f"leave out: {where}", "rows": stretches}])

    def drop(self, step: Any) -> None:
        """Remove a step; ValueError for the first.

        The others stay; the first says what the columns are.
        """
        step = _integer(step, "This step is no longer there.", 0, len(self.acts) - 1)
        if self.acts[step]["do"] == "roles":
            raise ValueError("The first step says what the columns are: change it at the left.")
        self._become([act for number, act in enumerate(self.acts) if number != step])

    def undo(self) -> None:
        """Take back what was done last."""
        self._go(self.at - 1, "There is nothing to undo.")

    def redo(self) -> None:
        """Do again what was undone."""
        self._go(self.at + 1, "There is nothing to do again.")

    def _go(self, to: int, refusal: str) -> None:
        if not 0 <= to < len(self.versions):
            raise ValueError(refusal)
        if self.versions[to]:
            self.fit(self.versions[to])
        self.at = to
        self.start()

    def _become(self, acts: list[Act]) -> None:
        """Fit these acts and keep them, if no error is raised."""
        self.fit(acts)
        self.versions = [*self.versions[: self.at + 1], acts][-1000:]
        self.at, self.problem = len(self.versions) - 1, ""

    # ------------------------------------------------------------------------------------------------------- the models

    def fit(self, acts: Sequence[Act] | None = None) -> Step:
        """The step of some acts, kept or refitted.

        Raises RecordError, ValueError: what the fit says of unusable data and settings.
        """
        acts = self.acts if acts is None else list(acts)
        key = self.key(acts)
        if key not in self._steps:
            self._steps[key] = found = self._fitted(key, acts)
            self._known.setdefault(key, {})["rms"] = _rms(_learned(found, found.curves))
        self._steps.move_to_end(key)
        # With three million rows of all steps together, fewer steps are kept.
        most = max(3, min(12, 3_000_000 // max(len(self.log.frame), 1)))
        for other in list(self._steps)[: max(len(self._steps) - most, 0)]:
            if other not in (key, self.key()):
                del self._steps[other]
        return self._steps[key]

    def _fitted(self, key: str, acts: Sequence[Act]) -> Step:
        roles = next((act["roles"] for act in acts if act["do"] == "roles"), None)
        if roles is None:
            raise RecordError("Say which column is the temperature and which the reading.")
        _check_roles(roles, list(self.log.frame.columns))
        log, said = self.log.timed(roles["time"])
        y = log[roles["reading"]]
        if kind_of(y) != "number":
            raise RecordError(f"The column {roles['reading']!r} holds no numbers, so it cannot be the reading.")
        own = [] if roles["reading"] == roles["temperature"] else [roles["reading"]]
        X = log.drop(columns=[*own, *(name for name in roles["ignored"] if name in log.columns)])
        stretches = _left_out(acts)
        learned = y.astype(float) if stretches else y.copy()
        for start, stop in stretches:
            learned.iloc[start:stop] = np.nan
        X.attrs, y.attrs, learned.attrs = dict(log.attrs), dict(log.attrs), dict(log.attrs)
        with noted() as notes:
            model = self.unfitted(acts).fit(X, learned)
            curves = Curves(model, X, y, keep=True)
        notes = list(dict.fromkeys((*notes, *model.notes_)))
        return Step(key, model, X, y, learned, stretches, said, tuple(notes), curves)

    def unfitted(self, acts: Sequence[Act]) -> DynamicBiasRegressor:
        """The model of some acts, before its fit."""
        model: DynamicBiasRegressor = clone(self.base)
        for act in acts:
            if act["do"] == "roles":
                roles = act["roles"]
                if roles["temperature"] != Thermometers.of(model.temperature).ambient:
                    model.set_params(temperature=roles["temperature"])
                time = None if self.log.files else roles["time"]
                model.set_params(reference=roles["reference"], time=time, run=roles["run"], **act["begun"])
            elif act["do"] == "shape":
                model.set_params(**{name: act[name] for name in ("time_constants", "degree", "products")})
            elif act["do"] == "add" and act["time_constants"]:
                model.set_params(time_constants=list(act["time_constants"]))
            elif act["do"] == "add":
                model = with_missing(model, self.codec.unpack(act["effect"], "effect"))
        return model

    def judge(self) -> Diagnosis:
        """Diagnose the current step, and measure all steps."""
        found = self.now
        if found is None:
            raise ValueError(self.problem or "There is no model yet: call begin().")
        found.lacking = ""
        if found.diagnosis is None:
            self._diagnose(found)
        while (chore := self._missing_error()) is not None:
            chore[1]()
        if found.diagnosis is None:
            raise RecordError(found.lacking)
        return found.diagnosis

    def next_chore(self) -> Chore | None:
        """The next unknown: words and a function; or None."""
        found = self.now
        if found is None:
            return None
        if self.key(self.acts[:1]) not in self.advice:
            return "which correction to use", self._advise
        if found.where is None:
            return "looking where it fails", lambda: self._look(found)
        if found.diagnosis is None and not found.lacking:
            return "looking for what is missing", lambda: self._diagnose(found)
        if not found.curves.uncertain and not found.lacking and found.model._knows_noise:
            return "uncertainty", lambda: self._doubt(found)
        return self._missing_error()

    def _advise(self) -> None:
        """Advise a correction, and begin with it if nothing is set."""
        first = self.acts[:1]
        variants = variants_of(self.unfitted(first), max(self.base.degree, 2))
        advice: Advice | None = None
        try:
            with quiet():
                found = self.fit(first)
                fitted = {name: each.fit(found.X, found.learned) for name, each in variants.items()}
                advice = advise(fitted, found.X, found.learned)
        except Exception:  # effects of the user's own raise whatever they like
            self.advice[self.key(first)] = None
            return
        if not self.settled and advice.variant and len(self.acts) == 1:
            chosen = variants[advice.variant].get_params(deep=False)
            begun = {"time_constants": chosen["time_constants"], "degree": chosen["degree"]}
            self.versions = [[{**act, "begun": begun} if act["do"] == "roles" else act for act in acts]
                             for acts in self.versions]  # fmt: skip
            self.fit()
        self.advice[self.key(self.acts[:1])] = advice
        if found.model._run_levels.times:
            with quiet():
                laws = {name: out_of_sample(model, found.X, found.learned) for name, model in fitted.items()}
            self._laws[self.key(self.acts[:1])] = laws

    def _look(self, found: Step) -> None:
        """Where it fails, before it is known why."""
        try:
            with quiet():
                found.where = first_look(found.model, found.X, found.learned)
        except Exception:  # what is wrong with the record, its diagnosis says
            found.where = pd.DataFrame()

    def _diagnose(self, found: Step) -> None:
        known = self._known.setdefault(found.key, {})
        try:
            with quiet():
                judged = diagnose(found.model, found.X, found.learned, suspects=self.own, progress=self.progress)
                found.diagnosis = judged = with_fitted_causes(judged, found.model, found.X, found.learned)
            assert judged.ahead is not None
            known |= {"verdict": judged.verdict, "held_out": judged.held_out_rms, "moment": judged.moment}
            known.setdefault("later", {})[judged.moment] = judged.ahead.later_rms(judged.moment)
        except Exception as error:  # effects of the user's own raise whatever they like
            found.lacking = known["no errors"] = sentence(error)

    def _doubt(self, found: Step) -> None:
        """The uncertainty of every reading, for the band around the model."""
        with quiet():
            found.curves = Curves(found.model, found.X, found.y, uncertainty=True, keep=True)

    def _missing_error(self) -> Chore | None:
        """The next step without an error, as a chore."""
        for count in range(1, len(self.acts) + 1):
            acts = self.acts[:count]
            known = self.known(acts)
            if "no errors" not in known and self.moment not in known.get("later", {}) and acts[0]["do"] == "roles":
                return f"measuring the error after step {count}", lambda acts=acts: self._measure(acts)
        return None

    def _measure(self, acts: Sequence[Act]) -> None:
        known = self.known(acts)
        try:
            found = self.fit(acts)
        except Exception as error:  # see above
            known["no errors"] = sentence(error)
            return
        if found.diagnosis is None:
            self._diagnose(found)
        if found.diagnosis is not None and found.diagnosis.ahead is not None:
            known.setdefault("later", {})[self.moment] = found.diagnosis.ahead.later_rms(self.moment)

    # ----------------------------------------------------------------------------------------------------- what is seen

    def display(self, name: str, **how: Any) -> Display | None:
        """A picture of the current step; None if too early.

        Parameters
        ----------
        name : {"errors", "time", "against", "where", "suspects", "contributions", "allan"}
        **how
            errors: promised (error that a suspect would leave). time: low, high (places [s]), columns (drawn below),
            versus (number of the act whose step is compared; the one before by default), levels (False: readings less
            the level of their run), preview (True: what `preview` found), cells (over
            the axis). against: column or condition, low, high.
        """
        found = self.now
        if name not in PICTURES:
            raise ValueError(f"There is no picture {name!r:.40}. There are: {', '.join(PICTURES)}.")
        if found is None:
            return None
        judged, model = found.diagnosis, found.model
        if name == "errors":
            table = self.errors()
            floor, promised = None if judged is None else judged.noise_floor, how.get("promised")
            last = table["step"].iloc[-1]
            errors = pd.Series(table["error"].to_numpy(), index=table["step"])
            return ErrorsDisplay(errors, model.reading_.unit, floor, last, promised)
        if name == "time":
            return self._over_time(found, how)
        if name == "against":
            span = None if how.get("low") is None else (_number(how["low"], "low"), _number(how["high"], "high"))
            return AgainstDisplay.of(found.curves, how.get("column") or None, span)
        if name in ("where", "suspects"):
            if judged is None:
                return None
            made = WhereDisplay.from_diagnosis(judged, found.X), SuspectsDisplay.from_diagnosis(judged)
            return made[name == "suspects"]
        if name == "contributions":
            return ContributionsDisplay.of(found.curves)
        return AllanDisplay.from_estimator(model, found.X, found.y)

    def _over_time(self, found: Step, how: dict[str, Any]) -> Display:
        low, high, line = how.get("low"), how.get("high"), found.curves.timeline
        span = None if low is None or high is None else (_number(low, "low"), _number(high, "high"))
        if span is not None and not 0 <= span[0] < span[1] <= 1.000001 * line.span:
            raise ValueError("This stretch does not lie on the axis.")
        others: dict[str, Curves] = {}
        number = how.get("versus")
        before = len(self.acts) - 1 if number is None else _integer(number, "This step", 0, len(self.acts) - 1) + 1
        earlier = self._steps.get(self.key(self.acts[:before])) if before else None
        if earlier is not None and earlier is not found:
            others["before" if number is None else f"after step {before}"] = earlier.curves
        if how.get("preview") and found.previewed is not None:
            others[f"with {found.previewed[0]}"] = found.previewed[1]
        columns = [name for name in how.get("columns", ()) if name in found.X.columns]
        return ResidualsDisplay.of(
            found.curves,
            found.diagnosis,
            columns=columns,
            others=others,
            span=span,
            learned=np.isfinite(found.learned.to_numpy(float)) if found.left_out else None,
            levels=bool(how.get("levels", True)),
            n_cells=_integer(how.get("cells", N_CELLS), "The number of cells", 100, 10_000),
        )

    def script(self) -> str:
        """Python code that comes to the same model, see `thermocorr.workbench.files.script`."""
        return script(self)

    def export(self, kind: str) -> bytes:
        """A file to take: "script", "model", "corrected" or "report".

        Raises ValueError for any other, and where there is no model yet.
        """
        return exported(self, kind)


def _guessed(frame: pd.DataFrame, given: dict[str, Any]) -> dict[str, Any] | None:
    """Guessed roles of the columns; None for a question."""
    known = {role: given.get(role) for role in ("temperature", "reading", "reference", "run")}
    found = guess(frame, **known)
    if found.temperature is None or found.reading is None:
        return None
    taken = {found.temperature, found.reading, found.run, *given.values()} if "ignored" not in given else set()
    ignored = [str(name) for name in frame.columns if is_counter(frame[name]) and name not in taken]
    roles = {**dict.fromkeys(ROLES), "ignored": ignored, **{k: v for k, v in given.items() if v is not None}}
    return {**roles, "temperature": found.temperature, "reading": found.reading, "run": found.run}


def _check_roles(roles: dict[str, Any], columns: Sequence[str]) -> None:
    """Raise RecordError for roles that contradict."""
    unknown = sorted(set(roles) - {*ROLES, "ignored"})
    if unknown:
        raise RecordError(f"{quoted(unknown[0])} is no role of a column. There are: {', '.join(ROLES)}.")
    if roles["temperature"] is None or roles["reading"] is None:
        raise RecordError("Say which column is the temperature and which the reading.")
    if not isinstance(roles["ignored"], list | tuple):
        raise RecordError("What is ignored is a list of columns.")
    named = [roles[role] for role in ROLES if roles[role] is not None]
    for name in (*named, *roles["ignored"]):
        if name not in columns:
            raise RecordError(f"There is no column {quoted(name)}. The log has: {listing(columns)}.")
    alone = [name for name in named if not (roles["reference"] and name == roles["temperature"] == roles["reading"])]
    twice = next((name for name in alone if alone.count(name) > 1), None)
    if twice is not None:
        raise RecordError(f"The column {quoted(twice)} cannot be two things at once. Give each role its own column.")
    lost = next((name for name in roles["ignored"] if name in named), None)
    if lost is not None:
        raise RecordError(f"The column {quoted(lost)} is used by the model and cannot be ignored as well.")


def _roles_act(roles: dict[str, Any]) -> Act:
    against = "" if roles["reference"] is None else f" against {roles['reference']}"
    text = f"{roles['reading']}{against} over {roles['temperature']}"
    return {"do": "roles", "text": text, "roles": {**roles, "ignored": list(roles["ignored"])}, "begun": {}}


def _left_out(acts: Sequence[Act]) -> list[tuple[int, int]]:
    """Stretches of rows that are not learned from."""
    return sorted({(start, stop) for act in acts if act["do"] == "leave_out" for start, stop in act["rows"]})


def _learned(found: Step, curves: Curves) -> np.ndarray:
    """Residual of the readings that are learned from; NaN elsewhere."""
    learned: np.ndarray = np.isfinite(found.learned.to_numpy(float))
    parts = [np.where(learned[part.rows], part.residual, np.nan) for part in curves.parts()]
    return np.asarray(np.concatenate(parts))


def _rms(values: np.ndarray) -> float:
    return rms(values[np.isfinite(values)])


def _integer(value: Any, what: str, low: int, high: int) -> int:
    if type(value) is not int or not low <= value <= high:
        said = what if what.endswith(".") else f"{what} is a whole number from {low} to {high}, not {value!r:.40}."
        raise ValueError(said)
    return value


def _number(value: Any, what: str) -> float:
    if type(value) not in (int, float) or abs(value) > 1e300 or math.isnan(value):
        raise ValueError(f"{what} is a number, not {value!r:.40}.")
    return float(value)


def chosen_lags(given: str) -> Any:
    """Time constants as typed: a number, "auto", "none", or ``60, 15min``."""
    words = given.strip()
    if words == "auto":
        return words
    if words == "none":
        return []
    if words.isascii() and words.isdigit() and len(words) < 3 and 0 < int(words) <= 64:
        return int(words)
    found: list[float | str] = []
    for part in filter(None, (word.strip() for word in words.split(","))):
        try:
            seconds: float | str = float(part)
        except ValueError:
            seconds = part
        if isinstance(seconds, float) and not (math.isfinite(seconds) and seconds > 0):
            raise ValueError(f"{part[:40]!r} is no time constant. Write such as 60, 15min, 2h.")
        found.append(seconds)
    if not found:
        raise ValueError("Say how many time constants to choose (6), auto, none, or which: 60, 15min, 2h.")
    return found


def sentence(error: BaseException) -> str:
    """Message of an error in one line."""
    if isinstance(error, MemoryError):
        return "There is not enough memory for this. Open a shorter log."
    said = " ".join(str(error).split())
    if isinstance(error, ValueError | TypeError | OSError) and said:
        return said
    return f"{type(error).__name__}: {said}" if said else type(error).__name__
