"""Heat conduction of the simulated devices against closed forms and an independent integration."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import erfc, erfcx

from thermocorr.datasets import HeatStack, Layer
from thermocorr.datasets import _heat as heat
from thermocorr.datasets._heat import scan


def biot_series(depth, time, biot):
    """Slab cooled from 1 to 0 at depth 1, insulated at depth 0: the textbook series in Fourier numbers."""
    total = 0.0
    for k in range(200):
        zeta = brentq(lambda z: z * np.sin(z) - biot * np.cos(z), k * np.pi + 1e-12, (k + 0.5) * np.pi)
        factor = 4 * np.sin(zeta) / (2 * zeta + np.sin(2 * zeta))
        total = total + factor * np.exp(-(zeta**2) * time) * np.cos(zeta * depth)
    return total


def cooled_slab(cells, biot, fourier):
    """The same slab by finite volumes: 20 mm, 0.5 W/(m K), 1e6 J/(m3 K); diffusion time 800 s."""
    stack = HeatStack([Layer("slab", 0.02, 0.5, 1e6, cells)], biot * 0.5 / 0.02)
    time = np.concatenate([[0.0], 800.0 * np.asarray(fourier)])
    field = stack.field(time, np.zeros(time.size), initial_offset=1.0)[1:]
    return 1 - stack.positions / 0.02, field


@pytest.mark.parametrize("biot", [0.1, 1.0, 20.0])
def test_slab_follows_the_biot_series_to_second_order(biot):
    fourier = np.array([0.05, 0.2, 1.0])
    errors = []
    for cells in (10, 20, 40):
        depth, field = cooled_slab(cells, biot, fourier)
        errors.append(np.abs(field - [biot_series(depth, time, biot) for time in fourier]).max())
    # Second order: each halving of the cells divides the error by 4; 3.5 leaves room for the next order.
    assert errors[0] / errors[1] > 3.5 and errors[1] / errors[2] > 3.5
    assert errors[2] < 1e-3


def test_thick_slab_follows_the_semi_infinite_body():
    conductivity, capacity, convection = 0.3, 2e6, 10.0
    stack = HeatStack([Layer("ground", 0.5, conductivity, capacity, 1000)], convection)
    time = np.array([0.0, 3600.0, 7200.0])
    field = stack.field(time, np.zeros(3), initial_offset=1.0)
    for k in (1, 2):
        spread = np.sqrt(conductivity / capacity * time[k])
        x = stack.positions[:200] / (2 * spread)
        y = x + convection * spread / conductivity
        # exp(...) erfc(y) of the textbook, written with erfcx so that it does not overflow
        exact = 1 - (erfc(x) - np.exp(-(x**2)) * erfcx(y))
        # 0.5 mm cells against a spread of 23 mm: (0.5/23)^2 = 5e-4 times a factor below 1
        np.testing.assert_allclose(field[k, :200], exact, atol=2e-4)


def test_two_convective_faces_are_a_symmetric_slab():
    half = HeatStack([Layer("slab", 0.01, 0.2, 1e6, 20)], 15.0)
    whole = HeatStack([Layer("slab", 0.02, 0.2, 1e6, 40)], 15.0, inner_convection=15.0)
    time, air = np.arange(50) * 60.0, np.random.default_rng(0).normal(size=50)
    field = whole.field(time, air)
    np.testing.assert_allclose(field[:, :20], half.field(time, air), atol=1e-12)
    np.testing.assert_allclose(field[:, 20:], field[:, :20][:, ::-1], atol=1e-12)


def test_cutting_a_slab_into_layers_changes_nothing():
    whole = HeatStack([Layer("slab", 0.012, 0.2, 1e6, 12)], 15.0)
    cut = HeatStack([Layer("a", 0.002, 0.2, 1e6, 2), Layer("b", 0.010, 0.2, 1e6, 10)], 15.0)
    np.testing.assert_allclose(cut.rates, whole.rates, rtol=1e-10)


def test_mean_delay_of_two_bodies_with_a_contact_layer_between():
    plates = [
        Layer("outer", 1e-3, 1e4, 2e6, 2),
        Layer("contact", 1e-4, 2e-3, 1.0, 1),
        Layer("inner", 1e-3, 1e4, 3e6, 2),
    ]
    joined = [plates[0], Layer("inner", 1e-3, 1e4, 3e6, 2, contact_resistance=0.05)]
    # Elmore's delay: every heat capacity times the resistance that it shares with the path from the air.
    outer, inner = 2e3, 3e3  # [J/(m2 K)]
    expected = (outer + inner) / 10.0 + inner * 0.05
    for layers in (plates, joined):
        stack = HeatStack(layers, 10.0)
        delay = stack.layer_mean("inner") @ stack.modes @ stack.time_constants
        assert delay == pytest.approx(expected, rel=1e-5)  # the plates themselves add 1e-7 m2 K/W


def by_solve_ivp(layers, outer, inner, time, air):
    """Independent integration of the same heat balance, written with heat flows, one step after the other."""
    width = np.concatenate([np.full(la.cells, la.thickness / la.cells) for la in layers])
    conductivity = np.concatenate([np.full(la.cells, la.conductivity) for la in layers])
    capacity = width * np.concatenate([np.full(la.cells, la.heat_capacity) for la in layers])

    def flow(now, theta):
        ambient = np.interp(now, time, air)
        heat_in = (ambient - theta[0]) / (1 / outer + width[0] / 2 / conductivity[0])
        back = (theta[-1] - ambient) / (1 / inner + width[-1] / 2 / conductivity[-1])
        between = -np.diff(theta) / (width[:-1] / 2 / conductivity[:-1] + width[1:] / 2 / conductivity[1:])
        flows = np.concatenate([[heat_in], between, [back]])
        return -np.diff(flows) / capacity

    theta, rows = np.full(width.size, air[0]), [np.full(width.size, air[0])]
    for k in range(time.size - 1):
        step = solve_ivp(flow, (time[k], time[k + 1]), theta, method="LSODA", rtol=1e-9, atol=1e-10)
        theta = step.y[:, -1]
        rows.append(theta)
    return np.array(rows)


def test_layers_against_solve_ivp_at_irregular_times():
    layers = [Layer("a", 0.002, 20.0, 2.4e6, 3), Layer("b", 0.004, 0.04, 5e4, 4), Layer("c", 0.003, 1.0, 2e6, 4)]
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(5.0, 120.0, 40))
    air = 20 + np.cumsum(rng.normal(size=40))
    field = HeatStack(layers, 12.0, 3.0).field(time, air)
    # Tolerance: that of the integrator (1e-9 of 20 degC per internal step).
    np.testing.assert_allclose(field, by_solve_ivp(layers, 12.0, 3.0, time, air), atol=2e-6)


def test_blocks_of_rows_agree_with_one_block(monkeypatch):
    stack = HeatStack([Layer("slab", 0.01, 0.3, 2e6, 10)], 15.0)
    rng = np.random.default_rng(2)
    for time in (np.arange(300.0), np.cumsum(rng.uniform(0.5, 2.0, 300))):
        air = np.cumsum(rng.normal(size=300))
        whole = stack.field(time, air, initial_offset=-1.0)
        monkeypatch.setattr(heat, "_CHUNK", 7)
        np.testing.assert_allclose(stack.field(time, air, initial_offset=-1.0), whole, atol=1e-12)
        monkeypatch.undo()


def test_output_is_first_and_second_degree_in_the_field():
    stack = HeatStack([Layer("skin", 0.001, 1.0, 2e6, 3), Layer("core", 0.01, 0.3, 2e6, 10)], 15.0)
    time, air = np.arange(200) * 30.0, 20 + np.sin(np.arange(200) / 9.0)
    linear, quadratic = 2 * stack.layer_mean("skin"), 0.1 * stack.layer_mean("core")
    excess = stack.field(time, air) - 20.5
    output = stack.respond(time, air, linear, quadratic, reference_temperature=20.5)
    np.testing.assert_allclose(output, excess @ linear + excess**2 @ quadratic, atol=1e-12)


def test_scan_is_the_recursion():
    rng = np.random.default_rng(3)
    for n in (1, 2, 5, 97, 100):
        decay, increment, start = rng.uniform(size=(n, 3)), rng.normal(size=(n, 3)), rng.normal(size=3)
        state, rows = start, []
        for k in range(n):
            state = decay[k] * state + increment[k]
            rows.append(state)
        np.testing.assert_allclose(scan(decay, increment, start), rows, atol=1e-12)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Layer("a", -1.0, 1.0, 1.0), r"'thickness' parameter of Layer .* Got -1.0 instead"),
        (lambda: HeatStack([], 1.0), "at least one Layer"),
        (lambda: HeatStack([Layer("a", 1.0, 1.0, 1.0)], 0.0), "'outer_convection' parameter"),
        (lambda: HeatStack([Layer("a", 1.0, 1.0, 1.0)], 1.0).layer_mean("b"), "The layers are: a"),
        (lambda: HeatStack([Layer("a", 1.0, 1.0, 1.0)], 1.0).field([0, 1, 1], [0, 0, 0]), "Row 2 does not come"),
        (lambda: HeatStack([Layer("a", 1.0, 1.0, 1.0)], 1.0).field([0, 1], [0, np.nan]), "finite"),
    ],
)
def test_heat_errors(call, words):
    with pytest.raises(ValueError, match=words):
        call()
