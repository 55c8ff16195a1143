"""Is a correction advised by the thermometer of another device, and by the true one?

    python benchmarks/placebo.py ../shared/records

Measured records are learned on 70 %: with their own thermometer, what is advised and its error on the rest besides the
best of level, static and dynamic; with the thermometers of other devices in its place, how often one is advised.
(Simulated readings and thermometers that have nothing to do with each other: tests/test_advice.py, `pytest --long`.)
"""

import numpy as np
import pandas as pd
from common import asked, rms
from real_records import every

from thermocorr import compare_variants


def main() -> None:
    records, foreign, tried = every(asked(__doc__, "folder").folder), list[str](), 0
    for name, (X, y, column, n) in records.items():
        degree = 1 if column == "recharge_mm" else 2
        comparison = compare_variants(X[[column]][:n], y[:n], temperature=column, degree=degree, n_blocks=2)
        truth = {variant: rms(model.residuals(X[[column]][n:], y[n:])) for variant, model in comparison.models.items()}
        truth[""] = rms(y[n:] - np.nanmean(y[:n]))
        advice = comparison.advice
        figures = {"predicted": advice.after, "truth": truth[advice.variant], "best": min(truth.values())}
        figures |= {"level": truth[""], "against copies [dB]": advice.copies_db}
        print(f"{name:22s} {advice.choice:8s}", *(f"{what} {value:.4g}" for what, value in figures.items()), flush=True)
        for other, (others, _, theirs, _) in records.items():
            if other.split()[0] == name.split()[0]:  # the same thermometer, or the weather of one place
                continue
            T = np.asarray(others[theirs].dropna(), float)
            T = np.interp(np.linspace(0, len(T) - 1, n), np.arange(len(T)), T) if len(T) < n else T[:n]
            X_other = pd.DataFrame({"temperature": T}, index=X.index[:n])
            found = compare_variants(X_other, y[:n], temperature="temperature", n_blocks=2).advice
            tried += 1
            proof = "no proof" if np.isnan(found.copies_db) else "proof"
            foreign += [f"{name} by {other} ({proof})"] if found.choice in ("static", "dynamic") else []
    print(f"foreign thermometers: advised in {len(foreign)} of {tried}", *foreign, sep="\n    ")


if __name__ == "__main__":
    main()
