"""The lag recursion, eqs. (17) (18) (19) (25), against closed forms, an ODE solver and extended precision."""

from decimal import Decimal, localcontext

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from thermocorr.equations import LagState, decay_and_gain, decays, equilibrium, lag_differences

EPS = np.finfo(float).eps
HOLDS = ["first_order", "zero_order"]
extended = pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="no extended precision on this machine")


def room(n, seed=0, offset=20.0):
    """A room temperature that wanders by a few kelvin [degC]."""
    rng = np.random.default_rng(seed)
    return offset + np.cumsum(rng.normal(0.0, 0.05, n)) + np.sin(np.arange(n) / 50.0)


GAPS = "but for some gaps"
STEPS = pytest.mark.parametrize("regular", [True, False, GAPS])


def some_steps(n, regular, seed=1):
    steps = np.full(n, 15.0) if regular else np.random.default_rng(seed).uniform(1.0, 60.0, n)
    if regular == GAPS:
        steps[[*range(90, n, 613)]] = 45.0
    return steps


def in_extended_precision(temperature, steps, time_constants, hold, state):
    """The recursion sample by sample with 64-bit mantissas."""
    T, dt, tau = (np.asarray(values, np.longdouble) for values in (temperature, steps, time_constants))
    d, before = np.asarray(state.lag_difference, np.longdouble), np.longdouble(state.temperature)
    rows = []
    for k in range(len(T)):
        ratio = dt[k] / tau
        gain = -np.expm1(-ratio) / ratio if hold == "first_order" else np.ones_like(ratio)
        d = np.exp(-ratio) * d - gain * (T[k] - before)
        before = T[k]
        rows.append(d)
    return np.array(rows)


@pytest.mark.parametrize("tau", [1.5, 40.0, 3600.0])
def test_step_of_the_temperature_is_forgotten_exponentially(tau):
    dt, n = 15.0, 400
    T = np.r_[20.0, np.full(n - 1, 21.0)]
    later = (np.arange(n - 1)) * dt
    held, _ = lag_differences(T, np.full(n, dt), np.array([tau]), hold="zero_order")
    line, _ = lag_differences(T, np.full(n, dt), np.array([tau]))
    # atol: the decay factor is rounded once, and n equal roundings of 1e-16 add up to n eps
    np.testing.assert_allclose(held[1:, 0], -np.exp(-later / tau), rtol=0, atol=n * EPS)
    # with a straight line the body has followed for one step already: eq. (25) integrated over the rise
    first = -(tau / dt) * -np.expm1(-dt / tau)
    np.testing.assert_allclose(line[1:, 0], first * np.exp(-later / tau), rtol=0, atol=n * EPS)
    assert held[0, 0] == line[0, 0] == 0.0


@pytest.mark.parametrize("tau", [1.5, 40.0, 3600.0])
def test_ramp_of_the_temperature_is_followed_with_a_delay_of_one_time_constant(tau):
    dt, n, rate = 15.0, 2000, 1e-3
    t = np.arange(n) * dt
    line, _ = lag_differences(rate * t, np.full(n, dt), np.array([tau]))
    held, _ = lag_differences(rate * t, np.full(n, dt), np.array([tau]), hold="zero_order")
    # rtol: T itself is rounded to eps times 30 K, hence each step of 15 mK to 3e-13 of itself
    np.testing.assert_allclose(line[1:, 0], -rate * tau * -np.expm1(-t[1:] / tau), rtol=1e-12)
    geometric = np.expm1(-t[1:] / tau) / np.expm1(-dt / tau)  # 1 + a + a^2 + ... of the stairs
    np.testing.assert_allclose(held[1:, 0], -rate * dt * geometric, rtol=1e-12)


@pytest.mark.parametrize("tau", [60.0, 600.0, 7200.0])
def test_finely_sampled_sine_comes_out_with_the_amplitude_and_phase_of_a_first_order_body(tau):
    dt, w = 2.0, 2 * np.pi / 3600.0
    t = np.arange(20_000) * dt
    T = np.sin(w * t)
    amplitude, phase = 1 / np.hypot(1.0, w * tau), np.arctan(w * tau)
    lagged = amplitude * np.sin(w * t - phase) + amplitude * np.sin(phase) * np.exp(-t / tau)  # starts at 0 = T(0)
    # A straight line misses the sine by at most w^2 dt^2 / 8, stairs by w dt; a body of unit gain cannot enlarge that.
    for hold, miss in (("first_order", (w * dt) ** 2 / 8), ("zero_order", w * dt)):
        d, _ = lag_differences(T, np.full(t.size, dt), np.array([tau]), hold=hold)
        error = np.abs(d[:, 0] + T - lagged).max()
        assert error <= miss * (1 + 1e-6) + 1e-12
        assert error > miss * 1e-3  # the bound is about this error and not about nothing


@pytest.mark.parametrize("hold", HOLDS)
def test_independent_integration_of_eq_17_agrees_on_irregular_steps(hold):
    n, tau = 60, np.array([20.0, 300.0])
    steps = some_steps(n, regular=False)
    T, t = room(n), np.cumsum(steps) - steps[0]

    def slope(x, psi, k):
        ambient = np.interp(x, t, T) if hold == "first_order" else T[k]
        return (ambient - psi) / tau

    psi = np.empty((n, 2))
    psi[0] = T[0]
    for k in range(n - 1):  # one call per step: the solver must not step over a kink of the temperature
        part = solve_ivp(slope, (t[k], t[k + 1]), psi[k], args=(k,), method="DOP853", rtol=1e-12, atol=1e-12)
        psi[k + 1] = part.y[:, -1]
    # atol: the solver's 1e-12 per step (of 20 degC), forgotten within a few dozen steps
    np.testing.assert_allclose(lag_differences(T, steps, tau, hold=hold)[0], psi - T[:, None], rtol=0, atol=1e-9)


@extended
@pytest.mark.parametrize("hold", HOLDS)
@STEPS
def test_every_time_constant_agrees_with_extended_precision(hold, regular):
    n = 4000
    steps, T = some_steps(n, regular), room(n, offset=300.0)
    record = steps.sum()
    tau = np.r_[0.01 * steps.min(), np.geomspace(steps.min(), record, 12), 1e6 * record]
    state = LagState(np.linspace(-1.0, 1.0, len(tau)), 299.5)
    expected = in_extended_precision(T, steps, tau, hold, state)
    error = np.abs(lag_differences(T, steps, tau, state, hold=hold)[0] - expected).max(axis=0)
    # Each step rounds three times at the size of d; a body remembers tau/dt steps, at most n of them.
    remembered = np.minimum(tau / steps.min(), n)
    assert (error <= (3 + remembered) * EPS * np.abs(expected).max(axis=0)).all()


@extended
def test_offset_of_300_kelvin_costs_nothing():
    n, steps, tau = 5000, np.full(5000, 15.0), np.array([60.0, 3600.0])
    T = 300.0 + np.round((room(n) - 20.0) * 2**30) / 2**30  # digits that both 300 K + x and x hold exactly
    shifted, _ = lag_differences(T, steps, tau)
    small, _ = lag_differences(T - 300.0, steps, tau)
    assert np.array_equal(shifted, small)


@pytest.mark.parametrize("hold", HOLDS)
@STEPS
@examples(25)
@given(cuts=st.lists(st.integers(1, 299), max_size=12, unique=True), given_state=st.booleans())
def test_any_cut_gives_the_same_bits(hold, regular, cuts, given_state):
    n, tau = 300, np.array([0.3, 15.0, 900.0, 1e5, 1e9])
    T, steps = room(n), some_steps(n, regular)
    start = LagState(np.array([0.1, -0.2, 0.3, 0.0, 1.0]), 19.0) if given_state else None
    whole, end = lag_differences(T, steps, tau, start, hold=hold)
    state, parts = start, []
    for low, high in zip([0, *sorted(cuts)], [*sorted(cuts), n], strict=True):
        part, state = lag_differences(T[low:high], steps[low:high], tau, state, hold=hold)
        parts.append(part)
    assert np.array_equal(np.vstack(parts), whole)
    assert np.array_equal(state.lag_difference, end.lag_difference)
    assert state.temperature == end.temperature == T[-1]


@pytest.mark.parametrize("hold", HOLDS)
@STEPS
def test_sample_by_sample_gives_the_same_bits(hold, regular):
    n, tau = 1000, np.array([3.0, 1499.0, 1501.0, 1e7])  # 15 s lies on both sides of the switch to the series
    T, steps = room(n), some_steps(n, regular)
    whole, _ = lag_differences(T, steps, tau, hold=hold)
    state, rows = None, []
    for k in range(n):
        row, state = lag_differences(T[k : k + 1], steps[k : k + 1], tau, state, hold=hold)
        rows.append(row[0])
    assert np.array_equal(np.array(rows), whole)


@pytest.mark.parametrize("hold", HOLDS)
def test_even_stretches_of_uneven_steps_give_the_same_bits(hold):
    """A block whose steps are all alike is computed with the factors of one step."""
    random = np.random.default_rng(4)
    lengths = random.integers(1, 700, 12)
    stretches = [np.full(n, 15.0) if i % 2 else random.uniform(1.0, 60.0, n) for i, n in enumerate(lengths)]
    stretches[2][-1], stretches[6][5] = 1e5, 4e6  # gaps: a long step besides short ones
    steps = np.concatenate(stretches)
    T = room(len(steps))
    tau = np.array([0.02, 15.0 / np.log(2.0) * 2, 43.0, 44.0, 60.0, 175.0, 3600.0, 1e5, 1e9])  # 0.35 = ln(2)/2 is near
    for taus in (tau, tau[:1], tau[2:6]):
        whole, _ = lag_differences(T, steps, taus, hold=hold)
        state, parts, at = None, [], 0
        for n in lengths:
            part, state = lag_differences(T[at : at + n], steps[at : at + n], taus, state, hold=hold)
            parts.append(part)
            at += n
        assert np.array_equal(np.vstack(parts), whole)


@pytest.mark.parametrize("given_state", [True, False])
def test_empty_block_changes_nothing(given_state):
    T, steps, tau = room(50), some_steps(50, False), np.array([60.0, 600.0])
    start = LagState(np.array([0.5, -0.5]), 19.0) if given_state else None
    nothing, state = lag_differences(T[:0], steps[:0], tau, start)
    assert nothing.shape == (0, 2)
    assert np.array_equal(lag_differences(T, steps, tau, state)[0], lag_differences(T, steps, tau, start)[0])


def test_first_step_is_not_used_without_a_state_and_inputs_stay_as_they_were():
    T, steps, tau = room(40), some_steps(40, False), np.array([60.0, 600.0])
    other, kept = np.r_[np.nan, steps[1:]], (T.copy(), steps.copy())
    assert np.array_equal(lag_differences(T, other, tau)[0], lag_differences(T, steps, tau)[0])
    assert np.array_equal(T, kept[0])
    assert np.array_equal(steps, kept[1])


def test_returned_state_survives_what_happens_to_the_columns():
    T, steps, tau = room(40), some_steps(40, True), np.array([60.0, 600.0])
    columns, state = lag_differences(T, steps, tau)
    last = columns[-1].copy()
    columns[:] = np.nan
    assert np.array_equal(state.lag_difference, last)


@pytest.mark.parametrize("hold", HOLDS)
@examples(25)
@given(a=st.floats(-3, 3), b=st.floats(-3, 3), seed=st.integers(0, 1000))
def test_lag_differences_are_linear_in_the_temperature(hold, a, b, seed):
    n, tau = 200, np.array([5.0, 200.0, 1e4])
    steps, one, two = some_steps(n, False), room(n, seed), room(n, seed + 1)
    expected = a * lag_differences(one, steps, tau, hold=hold)[0] + b * lag_differences(two, steps, tau, hold=hold)[0]
    # atol: a one + b two is rounded at 120 degC, each such error is felt once and forgotten
    both = lag_differences(a * one + b * two, steps, tau, hold=hold)[0]
    np.testing.assert_allclose(both, expected, rtol=0, atol=n * 120 * EPS)


@pytest.mark.parametrize("hold", HOLDS)
@examples(25)
@given(start=st.floats(-50, 50), last=st.floats(-50, 350), temperature=st.floats(-50, 350))
def test_constant_temperature_is_reached_from_any_state(hold, start, last, temperature):
    tau = np.array([1.0, 100.0, 1000.0])
    d, _ = lag_differences(
        np.full(5000, temperature), np.full(5000, 15.0), tau, LagState(np.full(3, start), last), hold=hold
    )
    assert np.abs(d[-1]).max() <= 500 * np.exp(-75.0)  # 75 of the longest time constants, from at most 450 K
    assert (np.abs(d[1:]) <= np.abs(d[:-1])).all()


def test_equilibrium_stays_exactly_at_rest():
    tau = np.geomspace(1.0, 1e6, 5)
    d, _ = lag_differences(np.full(100, 21.3), some_steps(100, False), tau, equilibrium(21.3, tau))
    assert not d.any()


def paper_form(lag_difference, temperature, time_constants):
    """Columns of eqs. (19) (25) as printed: psi [K s] less T [K]."""
    return (lag_difference + temperature[:, None]) * time_constants - temperature[:, None]


def test_paper_form_is_the_loop_of_eq_25_as_printed():
    n, dt, tau = 3000, 15.0, np.array([60.0, 900.0, 14_400.0])
    T, xi = room(n), 1 / tau
    psi = np.empty((n, 3))
    psi[0] = T[0] / xi  # equilibrium
    for k in range(n - 1):
        psi[k + 1] = np.exp(-xi * dt) * psi[k] + (1 - np.exp(-xi * dt)) / xi * T[k]
    d, _ = lag_differences(T, np.full(n, dt), tau, hold="zero_order")
    # rtol: the printed loop rounds at psi = 20 degC * tau in each of the tau/dt <= 1000 steps that it remembers
    np.testing.assert_allclose(paper_form(d, T, tau), psi - T[:, None], rtol=1e-12)


def test_paper_form_spans_the_same_space():
    n, tau = 3000, np.array([60.0, 900.0, 14_400.0])
    T = room(n)
    d, _ = lag_differences(T, np.full(n, 15.0), tau, hold="zero_order")
    target = np.random.default_rng(5).normal(size=n) + 3.0 * T
    fits = []
    for columns in (d, paper_form(d, T, tau)):
        matrix = np.column_stack((np.ones(n), T, columns))
        matrix /= np.linalg.norm(matrix, axis=0)
        fits.append(matrix @ np.linalg.lstsq(matrix, target, rcond=None)[0])
    # atol: the target is 60, the paper's columns are nearly parallel (condition about 1e5), so 60 * 1e5 * eps
    np.testing.assert_allclose(fits[0], fits[1], rtol=0, atol=1e-9)


def test_gain_is_right_on_both_sides_of_the_series_threshold():
    ratios = np.r_[np.geomspace(1e-15, 50.0, 200), 0.01, np.nextafter(0.01, 0), np.nextafter(0.01, 1)]
    exact_decay, exact_gain = [], []
    with localcontext() as context:
        context.prec = 60
        for ratio in ratios:
            r = Decimal(float(ratio))
            exact_decay.append(float((-r).exp()))
            exact_gain.append(float((1 - (-r).exp()) / r))
    decay, gain = decay_and_gain(ratios, 1.0)
    # decay is rounded at 1 (eps); above the threshold 1 - a has that error, of at least 0.01: 1.1e-14
    np.testing.assert_allclose(decay, exact_decay, rtol=2 * EPS, atol=EPS)
    np.testing.assert_allclose(gain, exact_gain, rtol=1.2e-14)
    series = ratios < 0.01
    np.testing.assert_allclose(gain[series], np.array(exact_gain)[series], rtol=3 * EPS)
    alone = np.array([decay_and_gain(ratios[k : k + 1], 1.0) for k in range(len(ratios))])[..., 0]
    assert np.array_equal(alone, np.column_stack((decay, gain)))  # alone or among others: the same bits


def test_zero_order_hold_has_gain_one_and_the_same_decay():
    steps = np.geomspace(1e-6, 1e6, 50)
    decay, gain = decay_and_gain(steps, 30.0, "zero_order")
    assert (gain == 1.0).all()
    assert np.array_equal(decay, decay_and_gain(steps, 30.0)[0])


def test_decays_are_exponentials_that_end_in_exact_zeros():
    t, tau = np.arange(0.0, 1e6, 15.0), np.array([0.5, 60.0, 3600.0, 1e7])
    columns = decays(t, tau)
    expected = np.exp(-t[:, None] / tau)
    expected[expected < 1e-20] = 0.0
    np.testing.assert_allclose(columns, expected, rtol=4 * EPS, atol=1.06e-20)  # exp(-46) = 1.05e-20 may go or stay
    assert (columns[0] == 1.0).all()
    assert (columns[-1, :3] == 0.0).all()
    assert columns[columns > 0].min() > 1e-21
    assert columns.flags.f_contiguous


@pytest.mark.parametrize("hold", HOLDS)
@STEPS
def test_compiled_and_plain_recursion_agree(monkeypatch, regular, hold):
    """4 ulp of the largest lag difference a sample: the two may fuse multiplication and addition or not."""
    pytest.importorskip("numba", reason="compiled code needs numba: pip install '.[fast]'")
    from thermocorr.equations import lags

    T, steps, taus = room(5000), some_steps(5000, regular), np.array([1.0, 20.0, 300.0, 4e3, 5e4, 6e5, 7e6])
    compiled, end = lag_differences(T, steps, taus, hold=hold)
    monkeypatch.setattr(lags, "follow", lambda *given: False)
    plain, same_end = lag_differences(T, steps, taus, hold=hold)
    np.testing.assert_allclose(compiled, plain, rtol=0, atol=1e-12 * np.abs(plain).max())
    np.testing.assert_allclose(end.lag_difference, same_end.lag_difference, rtol=0, atol=1e-12)


@STEPS
def test_inputs_of_any_kind_are_computed_in_double_precision(regular):
    T, steps, tau = room(700), some_steps(700, regular), np.array([16.0, 700.0, 8000.0])
    expected, _ = lag_differences(T, steps, tau)
    fixed = T.copy(), steps.copy()
    for values in fixed:
        values.flags.writeable = False
    assert np.array_equal(lag_differences(*fixed, tau)[0], expected)
    assert np.array_equal(lag_differences(np.repeat(T, 2)[::2], np.repeat(steps, 2)[::2], tau)[0], expected)
    for kind in ("f4", "i8", ">f8", np.longdouble):  # the time constants are exact in all of them
        assert np.array_equal(lag_differences(T, steps, tau.astype(kind))[0], expected)
