"""Which of several explanations is the cause: by likelihood, by what it is worth, and by what it is."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from thermocorr.effects import (
    Covariate,
    Drift,
    Hinge,
    Hysteresis,
    Interaction,
    LaggedCovariate,
    LaggedModulation,
    LagProducts,
    Periodic,
    SensitivityDrift,
    Step,
)
from thermocorr.judgement.causes import Search
from thermocorr.judgement.choice import Tried, chosen, plainer_than, still_sought, trifling
from thermocorr.judgement.needed import needed
from thermocorr.judgement.pool import Explanation
from thermocorr.judgement.worth import Worth
from thermocorr.records import Record
from thermocorr.records.thinned import Thinned


def tried(effect, score, later, blocks, number=0, full=None, p_value=1e-6, scatter=1.8, **options):
    return Tried(
        explanation=Explanation(effect, np.zeros((3, 1)), **options),
        number=number,
        score=score,
        full=score if full is None else full,
        as_law=score if full is None else full,
        p_value=p_value,
        worth=Worth(later=later, blocks=blocks),
        scatter=scatter,
        uneven=False,
    )


def best_of(*explanations, by_chance=False, settles=False):
    best, _ = chosen(explanations, lambda t: by_chance, lambda t: settles)
    return best and best.explanation.effect.kind


def test_what_helps_comes_before_what_is_only_likelier():
    assert best_of(tried(LagProducts(["1 h"]), 80.0, 0.2, 0.1), tried(Hinge(22.0), 30.0, 3.0, 4.0)) == "hinge"
    assert best_of(tried(LagProducts(["1 h"]), 80.0, 2.8, 3.5), tried(Hinge(22.0), 30.0, 3.0, 4.0)) == "lag_products"


@pytest.mark.parametrize(
    ("share", "help_db", "in_averages"), [(0.03, 0.02, True), (0.06, 0.02, False), (0.03, 0.2, False)]
)
def test_next_to_nothing_is_a_trifle_in_averages_alone(share, help_db, in_averages):
    """What explains little, or helps: in rows themselves, and where either is much, it is a cause like others."""
    t = tried(Hysteresis(0.1), 40.0, help_db, help_db)
    assert trifling(t, share, Thinned.__new__(Thinned)) is in_averages
    assert trifling(t, share, Record.__new__(Record)) is False


def test_a_step_that_spoils_the_worth_of_all_else_leaves_the_choice_to_the_likelihood():
    """A wave that is likelier than the step, and far less likely than the products that it imitates, is not taken."""
    step, wave = tried(Step(3600.0), 24.0, 5.6, 4.5), tried(Periodic("1 d", 1), 85.0, 0.2, 0.3)
    products = tried(LagProducts(["1 h"]), 799.0, 0.4, 0.3)
    assert best_of(step, wave, products) == "lag_products"
    assert best_of(step, wave) == "periodic"


@pytest.mark.parametrize(
    ("score", "later", "winner"),
    [
        (29.0, 2.5, "covariate"),
        (25.0, 2.5, "lagged_covariate"),
        (29.0, 0.1, "lagged_covariate"),
        (31.0, 0.1, "covariate"),
    ],
)
def test_a_column_as_it_is_comes_before_the_same_column_late(score, later, winner):
    """A tie is enough where it helps as much; where it does not, it must be likelier."""
    late = tried(LaggedCovariate("pressure", ["1 h"]), 30.0, 3.0, 2.8)
    assert best_of(late, tried(Covariate("pressure"), score, later, later)) == winner
    assert best_of(late, tried(Covariate("supply"), score, later, later)) == "lagged_covariate"


def test_a_column_that_does_harm_on_what_was_not_learned_from_is_not_accused():
    harm = tried(Covariate("pressure"), 11.0, -1.2, -2.1)
    assert best_of(harm) is None
    assert best_of(tried(Covariate("pressure"), 11.0, -2.5, 2.8)) == "covariate"
    assert best_of(tried(Covariate("pressure"), 11.0, -0.2, -0.1)) == "covariate"
    assert best_of(tried(Hinge(22.0), 11.0, -1.2, -2.1)) == "hinge"
    assert best_of(harm, tried(Interaction("supply"), 9.0, 0.4, 0.2)) == "interaction"


@pytest.mark.parametrize(("score", "scatter", "named"), [(20.0, 0.6, True), (11.0, 0.6, False), (35.0, 1.8, False)])
def test_a_column_that_does_harm_is_accused_where_its_evidence_is_strong_and_even(score, scatter, named):
    """A slow column may spoil forecasts though it is the cause."""
    assert (best_of(tried(Covariate("pressure"), score, -3.2, -3.1, scatter=scatter)) is not None) == named


def test_a_product_that_is_worth_nothing_on_what_was_not_learned_from_is_not_accused():
    """Beside a pumping well, recharge times the stage of a far river was proven, and worth nothing on either."""
    assert best_of(tried(Interaction("pressure"), 11.0, -0.01, -0.2)) is None
    assert best_of(tried(Interaction("pressure"), 11.0, -0.01, 0.2)) == "interaction"
    assert best_of(tried(Interaction("pressure"), 20.0, -0.01, -0.2)) == "interaction"  # strong evidence
    assert best_of(tried(LagProducts(["1 h"]), 11.0, -0.01, -0.2)) == "lag_products"


def test_what_is_not_proven_must_help_more_than_noise_does():
    helps = tried(Hinge(22.0), -2.0, 4.0, 5.0, p_value=1.0)
    assert best_of(helps) == "hinge" and best_of(helps, by_chance=True) is None
    assert best_of(tried(Step(3600.0), -2.0, 4.0, 5.0, p_value=1.0)) is None  # of time alone


@pytest.mark.parametrize("effect", [Interaction("room"), LaggedModulation(slow="room"), SensitivityDrift()])
def test_a_product_is_no_cause_without_proof(effect):
    """Beside a voltmeter's slow noise, the meter's own temperature times the bath's helped, and then doubled errors."""
    assert best_of(tried(effect, -2.0, 4.0, 5.0, p_value=1.0)) is None
    assert best_of(tried(effect, 20.0, 4.0, 5.0)) == effect.kind


@pytest.mark.parametrize(("score", "later", "named"), [(4.0, 8.3, True), (4.0, 3.0, False), (-0.1, 8.3, False)])
def test_a_drift_of_the_sensitivity_that_helps_clearly_is_a_cause_where_the_likelihood_speaks_for_it(
    score, later, named
):
    """On a voltmeter's record a planted one helped by 8.3 dB, and had a score of 4."""
    helps = tried(SensitivityDrift(), score, later, 6.5, p_value=0.02)
    assert best_of(helps) == ("sensitivity_drift" if named else None)
    assert best_of(helps, by_chance=True) is None
    assert best_of(tried(Interaction("room"), score, later, 6.5, p_value=0.02)) is None


@pytest.mark.parametrize(
    ("rival", "overlap", "same_kind", "winner"),
    [
        ({"score": 50.0}, 0.9, [], "sensitivity_drift"),
        ({"score": 50.0}, 0.4, [], "interaction"),  # it says something else: a further cause
        ({"score": 50.0, "later": 0.1, "blocks": 8.0}, 0.9, [], "interaction"),  # less than half of the help
        ({"score": 50.0, "p_value": 0.1}, 0.9, [], "interaction"),
        ({"score": 50.0, "full": 40.0}, 0.9, [], "interaction"),  # a few stretches decide between the two
        ({"score": 50.0}, 0.9, [60.0], "interaction"),  # likelier with another lag
        ({"score": 45.0}, 0.9, [], "interaction"),
    ],
)
def test_of_two_that_say_the_same_the_likelier_is_the_cause(rival, overlap, same_kind, winner):
    modulation = tried(Interaction("room"), 46.0, 8.9, 12.7)
    drift = tried(SensitivityDrift(), **{"later": 0.9, "blocks": 14.0, "number": 1, **rival})
    own = [modulation, *(tried(Interaction("room"), score, 1.0, 1.0, number=2) for score in same_kind)]
    search = object.__new__(Search)
    search.judged = SimpleNamespace(overlap=lambda one, other: overlap if (one, other) == (0, 1) else 0.0)
    assert search._likelier(modulation, [drift, *own], own).explanation.effect.kind == winner


def test_help_alone_names_a_recorded_column_only_where_it_is_clear():
    assert best_of(tried(Covariate("pressure"), -2.0, 2.8, 3.4, p_value=1.0)) is None
    assert best_of(tried(Covariate("pressure"), -2.0, 4.6, 4.5, p_value=1.0)) == "covariate"


def test_late_a_recorded_column_needs_strong_evidence_and_waves_are_counted():
    wave, hinge = tried(Periodic("1 d", 1), 50.0, 0.0, 0.0), tried(Hinge(22.0), 9.0, 0.0, 0.0)
    weak, uneven, strong = (
        tried(Covariate(column), score, 2.0, 2.0, scatter=scatter)
        for column, score, scatter in (("pressure", 12.0, 0.6), ("humidity", 50.0, 1.4), ("supply", 20.0, 0.6))
    )
    every = [wave, hinge, weak, uneven, strong]

    step = tried(Step(60.0), 30.0, 0.0, 0.0)

    def left(*found):
        return [t.key for t in still_sought(every, [SimpleNamespace(tried=t) for t in found], found.count(step))]

    assert left(*[hinge] * 7, *[step] * 5) == [t.key for t in every]
    assert left(*[hinge] * 8) == [wave.key, hinge.key, strong.key]
    assert left(*[wave] * 6) == [hinge.key, weak.key, uneven.key, strong.key]


def cause(hour, **options):
    return SimpleNamespace(tried=tried(Step(hour * 3600.0), 20.0, 1.0, 1.0, number=hour, **options), adopted=hour)


def kept(found, level_with):
    """What is kept of causes, of which each proves something that gains 10 and more beside others."""
    return needed(
        SimpleNamespace(level_with=level_with), found, lambda gain, _: 1e-4 if gain >= 10 else 0.5 - 0.01 * gain
    )


def test_of_two_causes_that_say_the_same_one_is_kept():
    """Neither is needed beside the other, and what both say is: they are taken out one at a time."""
    found = [cause(hour) for hour in range(4)]

    def level_with(those):  # 0 says a little more than 1; 2 is something else, 3 nothing
        return max([40.0 * (0 in those), 36.0 * (1 in those)]) + 2.0 * ({0, 1} <= set(those)) + 25.0 * (2 in those)

    assert kept(found, level_with) == [found[0], found[2]]
    assert kept(found[:1], level_with) == found[:1]


def test_what_is_needed_no_more_when_another_goes_goes_too():
    found = [cause(hour) for hour in range(3)]

    def level_with(those):  # 0 mends what 1 spoils; 2 alone matters
        return 30.0 * (2 in those) + (4.0 if {0, 1} <= set(those) else 2.0 * (0 in those) - 20.0 * (1 in those))

    assert kept(found, level_with) == [found[2]]


def test_causes_are_weighed_by_their_own_columns_where_one_goes_without_being_asked():
    """A cause of the model's own that only helps goes at once; the numbers of the others stay what they were."""
    found = [cause(0, p_value=0.5, in_model=True), cause(1), cause(2)]

    def level_with(those):
        assert set(those) <= {1, 2}
        return 30.0 * (1 in those) + 20.0 * (2 in those)

    assert kept(found, level_with) == found[1:]


def test_a_column_that_is_added_comes_before_a_product_that_says_the_same():
    """A product with one column, and a column that helps nearly as much and is not told apart from it."""
    product = tried(LaggedModulation(slow="meter", time_constant="6 min"), 9.0, 2.8, 6.0)
    room, weak = tried(LaggedCovariate("room", ["1 h"]), 6.0, 2.4, 5.0), tried(Covariate("meter"), 8.0, 1.0, 3.6)
    assert plainer_than(product, [room, weak]) is room
    assert plainer_than(product, [weak]) is None
    assert plainer_than(product, [tried(Interaction("meter"), 8.9, 2.8, 6.0)]) is None
    assert plainer_than(room, [weak]) is None  # nothing to be made plainer
    assert plainer_than(tried(LagProducts(["1 h"]), 9.0, 2.8, 6.0), [room]) is None  # of the temperature alone


def test_a_slow_effect_that_settles_what_wanders_is_named_though_not_proven():
    """A drift that is far likelier than noise as slow, leaves none of it, and is not contradicted by later data."""
    drift = tried(Drift(), 6.0, 0.6, 0.5, p_value=0.004)
    assert best_of(drift, settles=True) == "drift"
    assert best_of(drift) is None
    assert best_of(tried(Drift(), 4.0, 0.6, 0.5, p_value=0.02), settles=True) is None
    assert best_of(tried(Drift(), 6.0, -0.6, 0.5, p_value=0.004), settles=True) is None
    assert best_of(tried(Hysteresis(0.5), 6.0, 0.6, 0.5, p_value=0.004), settles=True) is None
