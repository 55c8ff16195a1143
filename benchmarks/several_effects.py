"""Several hidden effects at once: are all found, is any label untrue, and does the error fall to the floor?

    python benchmarks/several_effects.py --effects 2 --seeds 520 521 522 523
    python benchmarks/several_effects.py --effects 3 --strength 1 --refine

Settings, devices and decoy columns are those of `hidden_effects.py`; the kinds are drawn anew for each record. An
effect counts where the record can show it: what is left of it given the base model's columns and the other effects
gains at least `SHOWN` in log likelihood under the noise, which is white. It is found where it is a cause or in a
cause's declared set; a label is untrue where a cause's set holds no planted effect. A lagged column has the column as
it is, too (`LaggedCovariate`): where both are planted, its name says both. With `--refine`, the rms error of
the refined model against the truth over the noise.
"""

from __future__ import annotations

import argparse
import itertools
import warnings
from typing import Any

import numpy as np
import pandas as pd
from hidden_effects import NOISE, SETTINGS, Case, label, make_case, print_seeds

from thermocorr import RecordWarning, diagnose, refine
from thermocorr.effects import CATALOGUE

SHOWN = 15.0
"""Log likelihood; a diagnosis proves nothing that gains less than about 12."""
TUNING_SEEDS = range(500, 510)
"""Those that the choice among causes was bettered on; report on others."""
NOT_PLANTED = (
    "lead", "thermometer_noise", "sensitivity_step", "thermal_lag", "delay", "rate", "initial_transient",
    "quadratic_covariate",
)  # fmt: skip
"""Not planted by `make_record`, or taken up by the base model's own lags and decays."""


def drawn(setting: str, seed: int, n: int) -> list[str]:
    """Kinds of effects for a record."""
    rng = np.random.default_rng([seed, list(SETTINGS).index(setting), n])
    kinds = [kind for kind in CATALOGUE if kind not in NOT_PLANTED]
    return [str(kind) for kind in rng.choice(kinds, n, replace=False)]


def gains(case: Case, kinds: list[str]) -> list[float]:
    """Log likelihood that each planted effect gains given the base model and the other effects."""
    base = np.asarray(case.model.features_.transform(case.X), float)
    columns = case.truth[kinds].to_numpy()
    found = []
    for k in range(len(kinds)):
        beside = np.column_stack((np.ones(len(base)), base, np.delete(columns, k, axis=1)))
        left = columns[:, k] - beside @ np.linalg.lstsq(beside, columns[:, k])[0]
        found.append(float(left @ left) / NOISE**2 / 2)
    return found


def judge(setting: str, seed: int, n: int, strength: float, refined: bool) -> dict[str, Any] | None:
    """One record; None where it cannot be made."""
    kinds = drawn(setting, seed, n)
    try:
        case = make_case(setting, seed, dict.fromkeys(kinds, strength))
    except ValueError:
        return None
    shown = [name for name, gain in zip(case.labels, gains(case, kinds), strict=True) if gain >= SHOWN]
    found = diagnose(case.model, case.X, case.y)
    sets = [set(map(name_of, (cause.effect, *cause.confusable_with))) for cause in (*found.causes, *found.small)]
    named = set().union(*sets) if sets else set()
    late = [name for name in named & set(case.labels) if name.startswith("lagged_covariate:")]
    named |= {name.removeprefix("lagged_") for name in late}
    untrue = [sorted(names) for names in sets if not names & set(case.labels)]
    result = {"setting": setting, "seed": seed, "planted": case.labels, "shown": len(shown)}
    result |= {"missed": [name for name in shown if name not in named], "untrue": untrue, "causes": len(sets)}
    if refined:
        model = refine(case.model, case.X, case.y).model_
        truth = case.truth["noise_free"]
        result["error"] = float(np.sqrt(np.mean((model.predict(case.X) - truth) ** 2))) / NOISE
        result["before"] = float(np.sqrt(np.mean((case.model.predict(case.X) - truth) ** 2))) / NOISE
    return result


def name_of(effect: Any) -> str:
    """Kind and column."""
    inputs = effect.inputs()
    return label(effect.kind, inputs[0] if inputs else None)


def main() -> None:
    """Print a line for each record, and shares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--effects", type=int, default=2)
    parser.add_argument("--seeds", type=int, nargs="*", default=list(range(520, 528)))
    parser.add_argument("--strength", type=float, default=1.0)
    parser.add_argument("--refine", action="store_true", help="refine as well: the error against the truth")
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    print_seeds(options.seeds, TUNING_SEEDS)
    results = []
    for setting, seed in itertools.product(SETTINGS, options.seeds):
        result = judge(setting, seed, options.effects, options.strength, options.refine)
        if result is not None:
            results.append(result)
            print(*(f"{name} {value}" for name, value in result.items()), sep="; ", flush=True)
    table = pd.DataFrame(results)
    showing = table[table["shown"] > 0]
    print(f"\n{len(table)} records, {showing['shown'].sum()} effects that can be seen")
    print(f"all found in {np.mean(showing['missed'].map(len) == 0):.1%} of {len(showing)} records")
    print(f"labels that are not true: {table['untrue'].map(len).sum()} of {table['causes'].sum()}")
    if options.refine:
        print(f"error of the model over the noise: {table['before'].median():.2f} -> {table['error'].median():.3f}")
        print(f"below 0.15 in {np.mean(table['error'] < 0.15):.1%}, worst {table['error'].max():.2f}")


if __name__ == "__main__":
    main()
