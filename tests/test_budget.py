"""Budgets of uncertainty: the GUM's example, other people's arithmetic, and how values are written."""

from __future__ import annotations

import numpy as np
import pytest

from thermocorr.estimators.uncertainty.signed import Budget, BudgetLine, concise

GAUGE = {  # GUM (JCGM 100:2008), example H.1: calibration of an end gauge; nm, contributions of table H.1
    "standard": (25.0, 1.0, 18.0),
    "repeated observations": (5.8, 1.0, 24.0),
    "comparator, random": (3.9, 1.0, 5.0),
    "comparator, systematic": (6.7, 1.0, 8.0),
    "expansion difference": (0.58e-6, 5e7 * 0.1, 50.0),
    "temperature difference": (0.029, 50e6 * 11.5e-6, 2.0),
}


def budget(coverage):
    lines = tuple(
        BudgetLine(quantity=name, estimate=0.0, uncertainty=u, unit="nm", sensitivity=c, dof=dof)
        for name, (u, c, dof) in GAUGE.items()
    )
    return Budget(name="l", value=50_000_838.0, unit="nm", lines=lines, coverage=coverage, status="signed")


def test_the_end_gauge_of_the_guide():
    """H.1.5 and H.1.6: u = 32 nm, 16 degrees of freedom, U99 = 93 nm with k = 2.92 (rounded there at each step)."""
    found = budget(0.99)
    assert found.u == pytest.approx(32, abs=0.5)
    assert np.floor(found.dof) == pytest.approx(16, abs=1)
    assert found.k == pytest.approx(2.92, abs=0.05)
    assert pytest.approx(93, abs=2) == found.U


def test_it_is_what_gtc_makes_of_it():
    """GTC is the GUM tree calculator of the Measurement Standards Laboratory of New Zealand."""
    gtc = pytest.importorskip("GTC", reason="GTC is in the extra 'test'")
    total = gtc.ureal(50_000_838.0, 1e-12)
    for name, (u, sensitivity, dof) in GAUGE.items():
        total = total + sensitivity * gtc.ureal(0.0, u, dof, label=name)
    found = budget(0.95)
    assert found.u == pytest.approx(gtc.uncertainty(total), rel=1e-12)
    assert found.dof == pytest.approx(gtc.dof(total), rel=1e-9)
    assert found.k == pytest.approx(gtc.reporting.k_factor(gtc.dof(total), 95), rel=1e-6)


@pytest.mark.parametrize(
    ("value", "U", "text"),
    [
        (103.95712, 0.00013, "103.957 12(13)"),
        (252.4449, 0.594, "252.44(59)"),
        (10.0, 0.0996, "10.00(10)"),
        (10.0, 0.0999, "10.00(10)"),
        (1234567.0, 4321.0, "1234600(4300)"),
        (-0.5, 12.3, "0(12)"),
        (3.14159, 1.23, "3.1(1.2)"),
        (5.0, 0.0, "5(0)"),
    ],
)
def test_values_are_written_with_two_digits_of_uncertainty(value, U, text):
    assert concise(value, U) == text


def test_shares_add_up_and_tables_are_escaped():
    found = budget(0.95)
    assert found.frame()["share"].sum() == pytest.approx(1)
    strange = Budget(
        name="<x>", value=1.0, unit="%_&", status="provisional", coverage=0.95,
        lines=(BudgetLine(quantity="<script>", estimate=np.nan, uncertainty=1.0, unit="%"),),
    )  # fmt: skip
    assert strange.result().endswith("provisional")
    assert "infinite" in str(strange)
