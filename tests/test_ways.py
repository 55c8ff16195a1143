"""Two effects at once that look like a third one and its left-overs, and rivals of which one is enough."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.judgement.alike import superfluous
from thermocorr.judgement.causes import Search
from thermocorr.judgement.choice import Tried
from thermocorr.judgement.likelihood import Comparison
from thermocorr.judgement.pool import Explanation
from thermocorr.judgement.worth import Worth

pytestmark = pytest.mark.newest

CURVED = "static_polynomial", "lag_products"
CASES = [
    ("chamber", "box", 635, CURVED),  # a hinge and three more
    ("lab", "slab", 644, CURVED),  # a hinge and both
    ("chamber", "layered", 618, ("interaction", "sensitivity_drift")),  # three changes of sensitivity and a disturbance
    ("lab", "layered", 1002, ("covariate", "drift")),  # the column, late by a third of the record, and half the drift
    ("lab", "plate", 1017, ("drift", "covariate")),  # likewise
    ("chamber", "layered", 1302, ("lagged_modulation", "sensitivity_drift")),  # three steps of sensitivity
    ("lab", "slab", 1424, ("interaction", "lagged_modulation")),  # each is noise to the other: likewise
    ("lab", "plate", 2309, ("sensitivity_drift", "disturbance")),  # two steps of opposite size, and the drift
    ("lab", "layered", 3006, ("sensitivity_drift", "disturbance")),  # likewise
    ("lab", "slab", 2524, ("sensitivity_drift", "step")),  # a step of the sensitivity, whose slope the drift has
    (
        "chamber",
        "slab",
        2628,
        ("sensitivity_drift", "interaction"),
    ),  # a step of the sensitivity, and one of the reading
    ("chamber", "slab", 2320, ("lagged_modulation", "log_ageing")),  # a shorter lag, which took the ageing upon itself
]


def judged(setting, device, seed, kinds):
    n, step = {"lab": (20_160, 60.0), "chamber": (23_040, 30.0)}[setting]
    options = {"sampling_period": step, "setting": setting, "device": device, "noise": 0.2, "seed": seed}
    record = make_record(n, effects=dict.fromkeys(kinds, 1.0), **options)
    X, y = record.drop(columns="reading"), record["reading"]
    return diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)


@pytest.mark.parametrize(("setting", "device", "seed", "kinds"), CASES)
def test_two_effects_are_two_causes(setting, device, seed, kinds):
    found = judged(setting, device, seed, kinds)
    assert {cause.effect.kind for cause in found.causes} == set(kinds) and len(found.causes) == 2


@pytest.mark.parametrize(
    ("setting", "device", "seed", "kinds"),
    [
        # five steps of the sensitivity and a wave, the likelihood 182 lower: a product is noise to the other
        ("chamber", "box", 1623, ("periodic", "interaction", "lagged_modulation")),
        # beside the products of lags neither gains more than noise does, and both together 50 in log likelihood
        ("lab", "slab", 1600, ("lag_products", "interaction", "lagged_modulation")),
    ],
)
def test_two_products_are_found_beside_a_third_effect(setting, device, seed, kinds):
    found = judged(setting, device, seed, kinds)
    assert {cause.effect.kind for cause in found.causes} == set(kinds) and len(found.causes) == 3


def test_what_one_way_learns_of_copies_is_not_the_others():
    """A column that was compared with its copies in one way passed in another without."""
    search = object.__new__(Search)
    search.pool, search._first_look = SimpleNamespace(rows=SimpleNamespace(exact=True)), None
    search.judged, search.family = SimpleNamespace(copy=list), SimpleNamespace(beside=list)
    search.copies, search.moved_beside = {}, set()
    one, other = search.anew(), search.anew()
    one.copies["covariate", "c1"] = "compared"
    one.moved_beside.add((0, 1))
    assert not (other.copies or other.moved_beside or search.copies or search.moved_beside)


def test_a_column_that_harms_while_a_drift_is_missing_is_named_beside_it():
    """Alone it is proven, and does harm on later data: nothing was named, and the likelihood 130 lower."""
    found = judged("lab", "plate", 1445, ("lagged_covariate", "drift", "log_ageing"))
    assert {cause.effect.kind for cause in found.causes} == {"lagged_covariate", "drift", "log_ageing"}


def tried(number, columns, score, kind):
    class Kind:
        thermal_rank = 0
        info = None

        def inputs(self):
            return [kind]

    Kind.kind = kind
    worth = Worth(later=1.0, blocks=1.0)
    return Tried(
        explanation=Explanation(Kind(), columns), number=number, score=score, full=score, as_law=score,
        p_value=0.0, worth=worth, scatter=0.0, uneven=False,
    )  # fmt: skip


def test_a_rival_that_the_best_one_leaves_little_to_say_is_one_of_its_set():
    rng = np.random.default_rng(1)
    n = 3000
    one, other, else_ = rng.standard_normal((3, n, 1))
    near = one + 0.9 * other  # both say what half of the reading holds
    reading = 0.2 * one[:, 0] + 0.1 * else_[:, 0] + rng.standard_normal(n)
    beside = Comparison(reading, np.ones((n, 1)), np.zeros(n))
    beside.add([one, near, else_])
    explained = [
        tried(k, columns, 20.0, kind) for k, (columns, kind) in enumerate(((one, "a"), (near, "b"), (else_, "c")))
    ]
    assert superfluous(beside, explained[0], [], explained[1:]) == [explained[1]]
    assert superfluous(beside, explained[0], [explained[1]], explained[1:]) == []
    late = [tried(1, near, 10.0, "b")]  # too unlikely for a rival
    assert superfluous(beside, explained[0], [], late) == []
