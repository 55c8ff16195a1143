"""Is the answer to a measured record the correction that serves best on later data, and does it promise what comes?

    python benchmarks/answers.py ../shared/records

Learned on the first 70 %, with the refined model among the corrections; printed for each record: the choice, what its
first line promises, and the error on the rest beside that of the level, of every variant and of the refined model.
`--print` shows the answers themselves.
"""

from __future__ import annotations

import argparse
import warnings

import numpy as np
from placebo import later
from real_diagnosis import every

from thermocorr import DynamicBiasRegressor, RecordError, RecordWarning, compare_variants, refine
from thermocorr.estimators.advice import REFINED
from thermocorr.pages import Answer
from thermocorr.pages.answer import LINES, WIDTH


def main() -> None:
    """Print a line for each record, and how many keep what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", help="folder of the measured records")
    parser.add_argument("--print", action="store_true", help="print the answers")
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    ratios, promises, longest, widest = list[float](), list[float](), 0, 0
    for name, (X, y, column, n) in every(options.folder).items():
        degree = 1 if column == "recharge_mm" else 2
        model = DynamicBiasRegressor(column, degree=degree, run="run" if "run" in X else None)
        comparison = compare_variants(X[:n], y[:n], model=model, degree=degree, n_blocks=2)
        try:
            refinement, unjudged = refine(comparison.models[comparison.begun], X[:n], y[:n]), ""
        except RecordError as error:
            refinement, unjudged = None, str(error)
        answer = Answer.of(X[:n], y[:n], comparison=comparison, refinement=refinement, unjudged=unjudged)
        truth = later(comparison, X[n:], y[n:], float(np.nanmean(y[:n])))
        if refinement is not None:
            left = np.asarray(refinement.model_.residuals(X[n:], y[n:]), float)
            truth[REFINED] = float(np.sqrt(np.nanmean(left**2)))
        advice = answer.advised
        assert advice is not None
        chosen, best = truth[advice.variant], min(truth, key=truth.__getitem__)
        ratios.append(chosen / truth[best])
        promises.append(abs(20 * np.log10(advice.after / chosen)))
        lines = answer.lines()
        longest, widest = max(longest, len(lines)), max(widest, *map(len, lines))
        print(
            f"{name:22s} {advice.variant or 'none':18s} promised {advice.after:8.4g} truth {chosen:8.4g}, "
            f"best {best or 'level':18s} {truth[best]:8.4g}",
            flush=True,
        )
        if options.print:
            print(answer, end="\n\n", flush=True)
    count = len(ratios)
    print(f"at most 1.1 times the best: {sum(ratio <= 1.1 for ratio in ratios)} of {count}")
    print(f"promise within 2 dB: {sum(off <= 2 for off in promises)} of {count}")
    print(f"longest answer: {longest} lines (of {LINES}), {widest} characters (of {WIDTH})")


if __name__ == "__main__":
    main()
