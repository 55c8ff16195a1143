"""`refine`: add what is missing, one effect after the other, and watch the error fall."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import pandas as pd
from sklearn.base import clone

from ..equations import reduction_db
from ..estimators.progress import Progress, told
from ..estimators.regressor import DynamicBiasRegressor
from ..pages import RefinementPage
from ..pictures.words import effect_text
from ..records.checks import check_int
from ..records.errors import printable, said_once
from ..records.numbers import number_text, scale_of
from .adding import Errors, Extended, with_missing
from .diagnosis import diagnose
from .found import WIDTH, Diagnosis, FoundSuspect
from .levels import CLEARLY_LESS, JOINTLY, TRIES
from .shorter import shorter
from .worked_out import effects_of, fitted_with, tuned, worked_out


@dataclass(frozen=True, repr=False)
class Refinement(RefinementPage):
    """What `refine` did, step by step. Prints as a table."""

    steps: pd.DataFrame
    """One row a step: step, effect, change ("given", "added", "tuned"), rms (in sample), held_out_rms,
    later_rms (on blocks of the later half, each foretold from everything before it), db (held_out_rms against that of
    step 0 [dB], negative is good; printed as "held out [dB]"), verdict (of the diagnosis of that step's model). Step 0
    is the given model."""
    model_: DynamicBiasRegressor
    """The final model, fitted."""
    diagnoses: tuple[Diagnosis, ...] = field(repr=False)
    """Diagnosis of the model after each step."""
    untried: bool = False
    """Whether what the last diagnosis names has not been tried: no step was left for it."""

    def __str__(self) -> str:
        errors = ["rms", "held_out_rms", "later_rms"]
        scale = scale_of(self.steps[errors], self.diagnoses[-1].unit)
        heads = {name: f"{name.replace('_', ' ')} [{scale.unit}]" if scale.unit else name for name in errors}
        steps = self.steps.assign(**{name: scale.factor * self.steps[name] for name in errors}).drop(columns="change")
        steps = steps.rename(columns={**heads, "db": "held out [dB]"})
        lines = [
            steps.to_string(index=False, float_format=lambda value: number_text(value, 4), na_rep="-"),
            f"Verdict on the last model: {self.diagnoses[-1].verdict}",
        ]
        named = [f"{effect_text(cause.effect)} ({cause.standing})" for cause in self.diagnoses[-1].causes]
        if named:
            why = "No step was left." if self.untried else "Data that were not learned from speak against it."
            said = f"Named there, and not added: {', '.join(named)}. {why}"
            lines += textwrap.wrap(said, WIDTH, subsequent_indent="    ")
        return printable("\n".join(lines), "\n")

    __repr__ = __str__

    def plot(self) -> Any:
        """Draw the steps, and what is suspected after the last one; returns the figure (extra "plot")."""
        from ..pictures import plot_refinement

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
    progress: Progress = None,
) -> Refinement:
    """Add the best missing effect, fit, diagnose again, until no further effect helps on data it was not fitted to.

    Two errors decide: on held-out blocks of time, and on blocks of the later half, each foretold from everything before
    it; where later blocks cannot tell, held-out ones decide alone.

    1. A cause that diagnosis names is kept if one error falls by more than the other rises, and the error falls in at
       least twice as many blocks as it rises in. A proven one that raises neither may be of use in few blocks.
    2. What depends on time alone must lower the two together and raise neither; a proven drift or ageing may raise the
       held-out error by less than it lowers the later one.
    3. What the record cannot tell from a cause is tried as well: it takes its place if the errors are a tenth less, or
       if the cause is not kept.
    4. A proven effect that acts late is worked out: its parameters are moved to where it explains most beside the
       model's own lags, another time constant is taken if the two errors are a tenth less, and it gets further lags as
       long as each lowers them by 1 %.
    5. At the end the effects' parameters are tuned together, and kept so if the two errors, the lags of the temperature
       chosen anew, are less.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted or not; it stays as it is.
    X, y : as for `DynamicBiasRegressor.fit`
    columns, exclude, suspects : see `diagnose`
    max_steps : int
        Most effects to add.
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
    >>> bool(refinement.steps["held_out_rms"].iloc[-1] < refinement.steps["held_out_rms"].iloc[0])
    True
    """
    check_int("refine", "max_steps", max_steps, 0)
    wanted: dict[str, Any] = {"columns": columns, "exclude": exclude, "suspects": suspects}
    with told(progress) as say:
        return _whole(model, X, y, wanted, max_steps, say)


def _whole(
    model: DynamicBiasRegressor, X: Any, y: Any, wanted: dict[str, Any], max_steps: int, say: Callable[[str], None]
) -> Refinement:
    """Fit and judge, refine on fewer rows where there are many, and fit to all of them."""
    current = clone(model)
    if model.temperature is None and hasattr(model, "pipeline_"):  # X may hold more columns than the fitted frame
        current.set_params(temperature=model.features_.history_.record.temperature_name)
    say("fitting the model")
    current.fit(X, y)
    say("looking for what is missing")
    first = diagnose(current, X, y, **wanted)
    short = shorter(current, X, y, wanted["columns"], wanted["suspects"])
    if short is None:
        return _refined(current, X, y, first, wanted, max_steps, say)
    found = _refined(short.model.fit(short.X, short.y), short.X, short.y, first, wanted, max_steps, say)
    if len(found.diagnoses) == 1 and not any(found.steps["effect"]):
        return Refinement(found.steps, current, (first,), untried=found.untried)
    say("fitting the refined model to all rows")
    final = short.whole(found.model_, current).fit(X, y)
    say("looking for what is still missing")
    last = diagnose(final, X, y, **wanted)
    row = found.steps.index[-1]
    steps = found.steps.assign(
        rms=found.steps["rms"].where(found.steps.index != row, last.residual_rms),
        verdict=found.steps["verdict"].where(found.steps.index != row, last.verdict),
    )
    return Refinement(steps, final, (*found.diagnoses[:-1], last), untried=True)


def _refined(
    current: DynamicBiasRegressor,
    X: Any,
    y: Any,
    first: Diagnosis,
    wanted: dict[str, Any],
    max_steps: int,
    say: Callable[[str], None],
) -> Refinement:
    """Step by step from a fitted model, whose diagnosis is known."""
    say("measuring the error on held-out and on later blocks")
    start = best = Errors.of(current, X, y)
    diagnoses, untried = [first], True
    rows = [_step(0, "", "given", best, start, diagnoses[0])]
    try:
        for number in range(1, max_steps + 1):
            longer = _with_first_that_helps(current, X, y, best, diagnoses[-1], _at_step(number, say))
            if longer is None:
                untried = False
                break
            current, best, added = longer
            diagnoses.append(diagnose(current, X, y, **wanted))
            rows.append(_step(number, added.label(), "added", best, start, diagnoses[-1]))
        if len(diagnoses) > 1:
            say("tuning the effects' parameters together")
            moved = tuned(current, X, y, JOINTLY, range(len(effects_of(current))))
            if moved is not current:  # with lags chosen anew, as what it is compared with has them
                moved = fitted_with(current, effects_of(moved), X, y)
            errors = best if moved is current else Errors.of(moved, X, y)
            if errors.better_than(best):
                current = moved
                diagnoses.append(diagnose(current, X, y, **wanted))
                untried = True
                rows.append(_step(len(rows), "parameters tuned together", "tuned", errors, start, diagnoses[-1]))
    except KeyboardInterrupt:
        say("stopped")
    return Refinement(pd.DataFrame(rows), current, tuple(diagnoses), untried=untried)


def _at_step(number: int, say: Callable[[str], None]) -> Callable[[str], None]:
    return lambda text: say(f"step {number}: {text}")


def _with_first_that_helps(
    model: DynamicBiasRegressor, X: Any, y: Any, before: Errors, found: Diagnosis, say: Callable[[str], None]
) -> Extended | None:
    """The model with the first cause that helps, worked out where it is proven; None where none helps."""
    for cause in worth_trying(found):
        kept = _with_cause(model, X, y, before, cause, found.unit, say)
        if kept is not None:
            return worked_out(kept[0], X, y, *kept[1:], say) if cause.standing == "proven" else kept
    return None


def worth_trying(found: Diagnosis) -> list[FoundSuspect]:
    """Causes to try, those first that are worth most on data that were not learned from."""
    return sorted(found.causes, key=lambda cause: -round(min(cause.gain_db, cause.later_db), 1))[:TRIES]


def _with_cause(
    model: DynamicBiasRegressor,
    X: Any,
    y: Any,
    before: Errors,
    cause: FoundSuspect,
    unit: str,
    say: Callable[[str], None],
) -> Extended | None:
    """The model with a cause, its errors, and what was added; None where data not learned from speak against it.

    What the record does not tell from the cause takes its place where these data clearly do; what depends on time alone
    only where the cause is not kept, for it promises nothing for later data.
    """
    kept: Extended | None = None
    for effect in (cause.effect, *cause.confusable_with):
        say(f"adding {effect.title()}")
        extended = with_missing(model, effect).fit(X, y)
        errors = Errors.of(extended, X, y)
        proven = effect is cause.effect and cause.standing == "proven"
        if not errors.worth(effect, before, proven, cause.in_model):
            helpless = "does not help on data that it was not learned from"
            say(f"{effect.title()} {helpless}: {errors.text(unit, before)}")
        elif kept is None or (not effect.of_time_alone and errors.ratio(kept[1]) <= CLEARLY_LESS):
            kept = extended, errors, effect
    return kept


def _step(number: int, effect: str, change: str, errors: Errors, start: Errors, found: Diagnosis) -> dict[str, Any]:
    return {
        "step": number,
        "effect": effect,
        "change": change,
        "rms": found.residual_rms,
        "held_out_rms": errors.held_out,
        "later_rms": errors.later,
        "db": reduction_db(errors.held_out, start.held_out),
        "verdict": found.verdict,
    }
