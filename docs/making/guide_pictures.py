"""Pictures of the guide: displays of what the code of its pages has made."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

GUIDE = Path(__file__).parents[1] / "guide"
PICTURES: dict[str, dict[str, Callable[[dict[str, Any]], Any]]] = {
    "first": {"variants": lambda made: _displays().VariantsDisplay.from_comparison(made["comparison"])},
    "time_constants": {"step_response": lambda made: _displays().StepResponseDisplay.from_estimator(made["model"])},
    "missing": {
        "residuals": lambda made: _displays().ResidualsDisplay.from_estimator(
            made["model"], made["X"], made["y"], made["diagnosis"]
        ),
        "suspects": lambda made: _displays().SuspectsDisplay.from_diagnosis(made["diagnosis"]),
        "where": lambda made: _displays().WhereDisplay.from_diagnosis(made["diagnosis"]),
        "refinement": lambda made: _displays().RefinementDisplay.from_refinement(made["refinement"]),
    },
    "pictures": {
        "gallery_residuals": lambda made: _displays().ResidualsDisplay.from_estimator(
            made["model"], made["X"], made["y"], made["diagnosis"]
        ),
        "gallery_contributions": lambda made: _displays().ContributionsDisplay.from_estimator(made["model"], made["X"]),
        "gallery_inner": lambda made: _displays().InnerTemperaturesDisplay.from_estimator(made["model"], made["X"]),
        "gallery_spectrum": lambda made: _displays().SpectrumDisplay.from_estimator(made["model"]),
        "gallery_step": lambda made: _displays().StepResponseDisplay.from_estimator(made["model"]),
        "gallery_loop": lambda made: _displays().ResidualLoopDisplay.from_estimator(
            made["model"], made["X"], made["y"]
        ),
        "gallery_allan": lambda made: _displays().AllanDisplay.from_estimator(made["model"], made["X"], made["y"]),
        "gallery_where": lambda made: _displays().WhereDisplay.from_diagnosis(made["diagnosis"]),
        "gallery_suspects": lambda made: _displays().SuspectsDisplay.from_diagnosis(made["diagnosis"]),
    },
    "thermometers": {
        "thermometers": lambda made: _displays().ContributionsDisplay.from_estimator(made["both"], made["X"])
    },
    "uncertainty": {"budget": lambda made: _displays().BudgetDisplay.from_budget(made["signed"].budget(7000))},
    "trust": {"allan": lambda made: _displays().AllanDisplay.from_estimator(made["model"], made["X"], made["y"])},
}
"""Page -> picture -> display, from the names that the page's code has made."""


def _displays() -> Any:
    from thermocorr import displays

    return displays


def draw_all(folder: Path) -> None:
    """Draw the pictures of every page into `folder`."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    folder.mkdir(exist_ok=True)
    for page, pictures in PICTURES.items():
        made = names_of(GUIDE / f"{page}.md")
        for picture, display in pictures.items():
            display(made).plot()
            plt.savefig(folder / f"{picture}.png", dpi=90)
            plt.close("all")


def names_of(page: Path) -> dict[str, Any]:
    """Names that the code of a page makes."""
    names: dict[str, Any] = {"__name__": "page"}
    with contextlib.redirect_stdout(io.StringIO()):
        for code in re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE):
            exec(code, names)
    return names
