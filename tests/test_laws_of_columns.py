"""Which law a recorded column acts by: as it is, late, its square, or the square of its distance from its mean."""

import pytest

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.effects import QuadraticCovariate


@pytest.mark.parametrize("column", ["supply", "pressure"])
def test_curvature_about_the_usual_value_is_named(column):
    """Of a column that swings by a hundredth of its mean, whose own square is a straight line of it."""
    record = make_record(6000, effects=[(QuadraticCovariate(column), 1.0)], seed=31)
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature").fit(X, y)
    found = diagnose(model, X, y)
    assert [(cause.effect.kind, cause.effect.column) for cause in found.causes] == [("quadratic_covariate", column)]
    better = model.with_effect(found.best).fit(X, y)
    assert better.residual_std_ == pytest.approx(record.attrs["noise"], rel=0.05)
