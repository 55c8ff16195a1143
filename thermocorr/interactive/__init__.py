"""Floor 7: the workbench. A log, what its user did with it step by step, and a screen in a browser or a notebook."""

from .browser.widget import workbench

__all__ = ["workbench"]
