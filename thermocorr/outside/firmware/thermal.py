"""C of the thermal part: static law, lags, start-up decays, products of lags. Eqs. (3) (18) (19) (21)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement
from math import comb
from typing import Any

import numpy as np

from ...effects import InitialTransient, LagProducts, StaticPolynomial, ThermalLag
from ...effects.products import CoarseProducts
from ...equations import LagState, decays
from .emitters import Finish, Part, emits
from .lagbank import Group, Source
from .program import Program

_FORGOTTEN = 1e-9
"""Decays below it at the end of the fit are nothing in single precision."""
AMBIENT = Source("temperature", "change", "K")


def change(program: Program) -> str:
    """Local variable: change of the temperature since the sample before [K]."""
    return program.local("change", "temperature - s->temperature")


def shifted(coefficients: dict[int, float], shift: float) -> list[float]:
    """Coefficients c of ``sum c[m] u^m = sum coefficients[i] (u + shift)^i``, m = 0, 1, ..."""
    highest = max(coefficients, default=0)
    return [
        sum(a * comb(i, m) * shift ** (i - m) for i, a in coefficients.items() if i >= m) for m in range(highest + 1)
    ]


def horner(program: Program, coefficients: Sequence[float], variable: str, name: str, comment: str) -> str:
    """C expression of ``sum c[m] variable^m`` for m >= 1; `coefficients` begin with m = 1."""
    table = [program.constant(f"{name}_{m}", c, comment) if c else "" for m, c in enumerate(coefficients, 1)]
    text = table[-1]
    for constant in table[-2::-1]:
        text = f"({text} * {variable} + {constant})" if constant else f"({text} * {variable})"
    return f"{text} * {variable}"


@emits(StaticPolynomial)
def static_polynomial(part: Part) -> None:
    """Eq. (3) by Horner's rule."""
    program, effect = part.program, part.effect
    if not len(part.coefficients):
        return
    powers = range(effect.lowest_power, effect.degree + 1)
    shift = program.target.reference_temperature - effect.reference_temperature_
    constant, *rest = shifted(dict(zip(powers, part.coefficients, strict=True)), shift)
    program.bias_constant += constant
    program.temperature_power = max(program.temperature_power, effect.degree)
    deviation = program.deviation()
    value = horner(program, rest, deviation, part.name("static"), f"{part.per('K')}^i, i-th power of T - T0")
    program.add("output", f"bias += {value};  /* eq. (3) */")


def ambient_lags(part: Part, effect: Any, state: Any) -> Group:
    """Lags of the temperature, as a `ThermalLag` defines them."""
    program = part.program
    change(program)
    start = "rest"
    if effect.initial_state == "zero" and program.target.begins:
        shift = effect.reference_temperature_ - program.target.reference_temperature
        begins = program.shared("starts_from", shift, "K, where the device starts, less near T0")
        start = f"{begins} - {program.deviation()}"
    return part.lags.request(AMBIENT, effect.time_constants_, effect.hold, start, state)


@emits(ThermalLag)
def thermal_lag(part: Part) -> Finish:
    """Eq. (19); the paper's own form is ``(d + T) tau - T`` of the lag difference d."""
    effect = part.effect
    group = ambient_lags(part, effect, part.state)

    def finish() -> None:
        weights = np.asarray(part.coefficients, float)
        taus = effect.time_constants_
        columns = group.columns(taus)
        if effect.form == "paper":
            program = part.program
            slope = float(weights @ (taus - 1.0))
            program.bias_constant += slope * program.target.reference_temperature
            weight = program.constant(part.name("paper_slope"), slope, part.per("K"))
            program.add("output", f"bias += {weight} * {program.deviation()};")
            weights = weights * taus
        part.program.weigh(part.name("mu"), weights, columns, part.per("K"))

    return finish


@emits(InitialTransient)
def initial_transient(part: Part) -> Finish | None:
    """Eq. (18): decays belong to fitted segments, so that only a program that continues the last one has them."""
    target, effect = part.program.target, part.effect
    if not target.continues:
        return None
    last = len(target.fitted_history.record.segments) - 1
    taus = effect.decays_.get(last)
    if taus is None:
        return None
    at = effect.first_column_[last]
    left = decays(np.array([target.segment_elapsed]), taus)[0]
    felt = left > (_FORGOTTEN if target.single else 0.0)
    weights, taus = np.asarray(part.coefficients[at : at + len(taus)])[felt], taus[felt]
    ended = LagState(left[felt], 0.0)
    group = part.lags.request(Source("decay of the start", "", "1"), taus, end=ended)
    return lambda: part.program.weigh(part.name("nu"), weights, group.columns(taus), part.per(""))


@emits(LagProducts, CoarseProducts)
def lag_products(part: Part) -> Finish:
    """Eq. (21): ``sum_j d_j (sum_k c_jk d_k + b_j (T - T0))``, one multiply-add for each pair and each lag."""
    program, effect = part.program, part.effect
    lags = effect
    group = ambient_lags(part, lags, part.state)

    def finish() -> None:
        columns, n = group.columns(lags.time_constants_), len(lags.time_constants_)
        weights = iter(part.coefficients)
        rows: list[list[str]] = [[] for _ in range(n)]
        unit = part.per("K^2")
        for j, k in combinations_with_replacement(range(n), 2):
            name = program.constant(part.name(f"mu_{j + 1}_{k + 1}"), float(next(weights)), unit)
            rows[j].append(f"{name} * {columns[k]}")
        if effect.temperature_products:
            shift = program.target.reference_temperature - effect.reference_temperature_
            for j, b in enumerate(weights):
                name = program.constant(part.name(f"mu_t_{j + 1}"), float(b), unit)
                rows[j].append(f"{name} * {program.deviation()}")
                if shift:
                    rows[j].append(program.constant(part.name(f"mu_t0_{j + 1}"), float(b) * shift, part.per("K")))
        for j, row in enumerate(rows):
            program.add("output", f"bias += {columns[j]} * ({' + '.join(row)});  /* eq. (21) */")

    return finish
