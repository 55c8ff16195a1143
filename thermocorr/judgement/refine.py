"""`refine`: add effects while the later error falls."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects import CATALOGUE, Hinge, LaggedCovariate, ThermalLag
from ..effects.protocol import Effect
from ..effects.thermal import seconds_array
from ..effects.wrap import as_effects
from ..equations import reduction_db
from ..model.progress import Progress, reporting
from ..model.regressor import DynamicBiasRegressor
from ..model.thermometers import Thermometers
from ..output.report import RefinementPage
from ..output.words import effect_text, page_width
from ..records.errors import check_bool, check_int, printable, said_once
from ..records.numbers import number_text, scale_of, unit_text
from .diagnose import diagnose, out_of_sample
from .report import Diagnosis, FoundSuspect
from .terms import helps_evenly, passes_twice


@dataclass(frozen=True, repr=False)
class Refinement(RefinementPage):
    """Steps of `refine`. Prints as a table."""

    steps: pd.DataFrame
    """One row a step: step, effect, change ("given" or "added"), rms (in sample), held_out_rms, later_rms (on stretches
    of the later part, each predicted from everything before it; behind the last moment where one was added that has a
    date), db (later_rms against that of step 0 [dB], negative is good; printed as "later [dB]"), low, high (the least
    and the greatest of that among the stretches), verdict (of the diagnosis of that step's model). Step 0 is the given
    model."""
    model_: DynamicBiasRegressor
    """The final model, fitted."""
    diagnoses: tuple[Diagnosis, ...] = field(repr=False)
    """Diagnosis of the model after each step."""
    added: tuple[tuple[FoundSuspect, ...], ...] = ()
    """What each step added."""
    untried: bool = False
    """True if what the last diagnosis names has not been tried: no step was left for it."""

    @property
    def moment(self) -> float | None:
        """Last dated share of the record among added effects."""
        return _last_moment(self.added)

    def __str__(self) -> str:
        errors = ["rms", "held_out_rms", "later_rms"]
        scale = scale_of(self.steps[errors], self.diagnoses[-1].unit)
        heads = {name: f"{name.replace('_', ' ')} [{unit_text(scale.unit)}]" if scale.unit else name for name in errors}
        steps = self.steps.assign(**{name: scale.factor * self.steps[name] for name in errors}).drop(
            columns=["change", "low", "high"]
        )
        steps = steps.rename(columns={**heads, "db": "later [dB]"})
        lines = [
            steps.to_string(index=False, float_format=lambda value: number_text(value, 4), na_rep="-"),
            f"Verdict on the last model: {self.diagnoses[-1].verdict}",
        ]
        named = [f"{effect_text(cause.effect)} ({cause.standing})" for cause in self.diagnoses[-1].causes]
        if named:
            why = "No step was left." if self.untried else "Later data do not confirm it."
            said = f"Named there, and not added: {', '.join(named)}. {why}"
            lines += textwrap.wrap(said, page_width(), subsequent_indent="    ")
        return printable("\n".join(lines), "\n")

    __repr__ = __str__

    def plot(self) -> Any:
        """Draw the steps and the last suspects (extra "plot").

        Returns the figure.
        """
        from ..output.diagnosis_displays import plot_refinement

        return plot_refinement(self)


@said_once()
def refine(
    model: DynamicBiasRegressor,
    X: Any,
    y: Any,
    *,
    columns: Sequence[Any] | None = None,
    exclude: Collection[str] = (),
    suspects: Sequence[Any] = (),
    max_steps: int = 5,
    deployable: bool = False,
    progress: Progress = None,
) -> Refinement:
    """Add what is worth adding, fit, diagnose again, until nothing is.

    The causes that a diagnosis names are added, and the model is fitted with them. They are kept if the fitted model
    predicts later stretches better than the one before, by half a decibel and in most of them; a product, or what has
    memory, must not cost much in any. Else they are tried one by one.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted or not; it stays as it is.
    X, y : as for `DynamicBiasRegressor.fit`
    columns, exclude, suspects : see `diagnose`
    max_steps : int
        Most effects to add.
    deployable : bool, default False
        Add only what can run sample by sample, live and on a device: nothing that needs later temperatures, as a lead.
    progress : callable or True, optional
        Called with a line of text before each step; True draws a bar (extra "progress"). A function may raise
        KeyboardInterrupt, which ends the refinement with what it has.

    Returns
    -------
    Refinement

    Examples
    --------
    >>> from thermocorr import DynamicBiasRegressor, refine
    >>> from thermocorr.datasets import make_record
    >>> record = make_record(2000, effects={"step": 2.0}, seed=1)
    >>> X, y = record.drop(columns="reading"), record["reading"]
    >>> refinement = refine(DynamicBiasRegressor("temperature"), X, y)
    >>> refinement.diagnoses[-1].verdict
    'nothing missing'
    >>> bool(refinement.steps["later_rms"].iloc[-1] < refinement.steps["later_rms"].iloc[0])
    True
    """
    check_int("refine", "max_steps", max_steps, 0)
    if check_bool("refine", "deployable", deployable):
        exclude = {*exclude, *(kind for kind, effects in CATALOGUE.items() if effects.foresees)}
        suspects = [one for one in suspects if not getattr(one, "foresees", False)]
    wanted: dict[str, Any] = {"columns": columns, "exclude": exclude, "suspects": suspects}
    current = clone(model)
    if model.temperature is None and hasattr(model, "pipeline_"):  # X may hold more columns than the fitted frame
        current.set_params(temperature=model.features_.history_.record.temperature_name)
    with reporting(progress) as say:
        say("fitting the model")
        current.fit(X, y)
        say("looking for what is missing")
        diagnoses, added, untried = [diagnose(current, X, y, **wanted)], list[list[FoundSuspect]](), False
        try:
            while diagnoses[-1].causes:
                if sum(map(len, added)) >= max_steps:
                    untried = True
                    break
                some = diagnoses[-1].causes[: max_steps - sum(map(len, added))]
                longer = _confirmed(current, X, y, diagnoses[-1], some, wanted, _at_step(len(diagnoses), say))
                if longer is None:
                    break
                current, found, causes = longer
                added.append(causes)
                diagnoses.append(found)
        except KeyboardInterrupt:
            say("stopped")
    return Refinement(_steps(diagnoses, added), current, tuple(diagnoses), tuple(map(tuple, added)), untried)


def _at_step(number: int, say: Callable[[str], None]) -> Callable[[str], None]:
    return lambda text: say(f"step {number}: {text}")


def _confirmed(
    model: DynamicBiasRegressor,
    X: Any,
    y: Any,
    before: Diagnosis,
    causes: Sequence[FoundSuspect],
    wanted: dict[str, Any],
    say: Callable[[str], None],
) -> tuple[DynamicBiasRegressor, Diagnosis, list[FoundSuspect]] | None:
    """The model with confirmed causes; None for none."""
    each = [[cause] for cause in causes]
    for some in each if len(each) == 1 else [list(causes), *each]:
        title, extended = " and ".join(cause.effect.title() for cause in some), model
        say(f"adding {title}")
        for cause in some:
            extended = with_missing(extended, cause.effect).fit(X, y)
        found = diagnose(extended, X, y, **wanted)
        assert before.ahead is not None and found.ahead is not None
        moment = max((cause.moment for cause in some if cause.moment is not None), default=None)
        evenly, twice = (any(map(asks, (cause.effect for cause in some))) for asks in (helps_evenly, passes_twice))
        if before.ahead.against(found.ahead, moment).adds(evenly, twice):
            return extended, found, some
        say(f"{title} does not help on later data")
    return None


def _last_moment(added: Sequence[Sequence[FoundSuspect]]) -> float | None:
    return max((cause.moment for causes in added for cause in causes if cause.moment is not None), default=None)


def _steps(diagnoses: Sequence[Diagnosis], added: Sequence[Sequence[FoundSuspect]]) -> pd.DataFrame:
    """The table: all errors on the same stretches."""
    moment = _last_moment(added)
    rows = []
    for number, (causes, found) in enumerate(zip([[], *added], diagnoses, strict=True)):
        assert found.ahead is not None and diagnoses[0].ahead is not None
        start = diagnoses[0].ahead
        later, first = found.ahead.later_rms(moment), start.later_rms(moment)
        falls = 10 * np.log10(start.reading_errors(moment) / found.ahead.reading_errors(moment))
        rows.append(
            {
                "step": number,
                "effect": " + ".join(cause.label for cause in causes),
                "change": "added" if causes else "given",
                "rms": found.residual_rms,
                "held_out_rms": found.ahead.held_out_rms,
                "later_rms": later,
                "db": reduction_db(later, first),
                "low": -max(falls.tolist(), default=np.nan),
                "high": -min(falls.tolist(), default=np.nan),
                "verdict": found.verdict,
            }
        )
    return pd.DataFrame(rows)


def with_fitted_causes(diagnosis: Diagnosis, model: DynamicBiasRegressor, X: Any, y: Any, most: int = 3) -> Diagnosis:
    """The diagnosis, errors of its first causes fitted.

    Of these, one that does not lower the error on later stretches is a cause no more.
    """
    assert diagnosis.ahead is not None
    shown, not_shown = list[FoundSuspect](), list[FoundSuspect]()
    for cause in diagnosis.causes[:most]:
        ahead = out_of_sample(with_missing(model, cause.effect).fit(X, y), X, y)
        moment = max((m for m in (diagnosis.moment, cause.moment) if m is not None), default=None)
        falls = diagnosis.ahead.against(ahead, moment).short
        before, after = diagnosis.ahead.later_rms(moment), ahead.later_rms(moment)
        fitted = replace(cause, before=before, after=after, each=falls.each)
        fitted = replace(fitted, later_db=falls.later, gain_db=falls.blocks)
        (shown if fitted.after < fitted.before else not_shown).append(fitted)
    shown.sort(key=lambda cause: -cause.later_db)
    named = diagnosis.n_causes + diagnosis.n_small
    suspects = (*shown, *diagnosis.suspects[most:named], *not_shown, *diagnosis.suspects[named:])
    return replace(diagnosis, suspects=suspects, n_causes=diagnosis.n_causes - len(not_shown))


def with_missing(model: DynamicBiasRegressor, effect: Effect) -> DynamicBiasRegressor:
    """An unfitted copy with one effect more.

    Products of lags are those of the model: what is better or worse is so for the effect.
    """
    extended: DynamicBiasRegressor = clone(model)
    if isinstance(effect, ThermalLag) and len(model.time_constants_):
        return extended.set_params(**_with_times(model, None, effect.time_constants))
    if (
        isinstance(effect, LaggedCovariate)
        and effect.power == 1
        and effect.column in Thermometers.of(model.temperature).further
    ):
        return extended.set_params(**_with_times(model, effect.column, effect.time_constants))
    own = [other for _, other in as_effects(model.effects)]
    for i, other in enumerate(own):
        if isinstance(effect, Hinge | LaggedCovariate) and same_but_for_lags(effect, other):
            times = sorted({*seconds_array(other.time_constants), *seconds_array(effect.time_constants)})
            longer = clone(other).set_params(time_constants=[float(tau) for tau in times])
            extended.set_params(effects=[clone(e) for e in (*own[:i], longer, *own[i + 1 :])])
            return extended
    return extended.with_effect(effect)


def _with_times(model: DynamicBiasRegressor, thermometer: Any, more: Any) -> dict[str, Any]:
    """Choices with further time constants of one thermometer."""
    found = dict(model.thermometers_)
    name = next(iter(found)) if thermometer is None else thermometer
    found[name] = np.unique([*found[name], *seconds_array(more)])
    times = {each: taus.tolist() for each, taus in found.items()}
    return {"time_constants": times if len(times) > 1 else times[name]}


def same_but_for_lags(one: Effect, other: Effect) -> bool:
    """True if two effects differ in lags alone."""
    params = [{k: v for k, v in e.get_params(deep=False).items() if k != "time_constants"} for e in (one, other)]
    return type(one) is type(other) and params[0] == params[1]
