"""The workbench: a record and its models, on a screen or without.

``thermocorr.workbench(model, X, y)`` shows it in a notebook, the command ``thermocorr workbench log.csv`` in a browser.
"""

import sys
from collections.abc import Sequence
from types import ModuleType
from typing import Any

from .story import Story

__all__ = ["Story"]


class _Workbench(ModuleType):
    """A module that can be called, as a notebook does."""

    def __call__(self, model: Any, X: Any, y: Any, *, suspects: Sequence[Any] = ()) -> Any:
        """Show a story in a notebook, see `thermocorr.workbench.screen.widget.show`."""
        from .screen.widget import show

        return show(Story.of(model, X, y, suspects=suspects))


sys.modules[__name__].__class__ = _Workbench
