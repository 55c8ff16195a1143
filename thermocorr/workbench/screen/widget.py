"""A story in a notebook, over the kernel's messages."""

from __future__ import annotations

import asyncio
import contextlib
from functools import partial
from typing import Any

from ...model import DynamicBiasRegressor
from ..story import Story
from . import page_assets
from .desk import Desk


def show(story: Story) -> Any:
    """Show a story in a notebook.

    Parameters
    ----------
    story : Story
        Such as `Story.of` makes it of a model, X and y. Widget.model is the model as it stands on the screen.

    Returns
    -------
    Widget
        Shown by the notebook. Without the package anywidget (extra "jupyter"): the `Diagnosis`, whose short form the
        notebook shows instead; its `save_html` writes the page.

    Raises
    ------
    RecordError
        For a record that cannot be used.
    """
    story.fit()
    try:
        import anywidget  # noqa: F401
    except ImportError:
        return story.judge()
    return _widget_class()(story)


def _widget_class() -> Any:
    """The widget's class; anywidget is an extra."""
    import anywidget
    import traitlets

    class Widget(anywidget.AnyWidget):
        """The workbench in a notebook."""

        _esm = page_assets.module()
        _css = page_assets.style()
        body = traitlets.Unicode(page_assets.body()).tag(sync=True)

        def __init__(self, story: Story):
            super().__init__()
            self.desk = Desk(story, self.send)
            with contextlib.suppress(RuntimeError):  # there is no kernel
                self.desk.later = partial(asyncio.get_running_loop().call_later, 0.01)
            self.on_msg(lambda widget, content, buffers: self.desk.hear(content))

        @property
        def model(self) -> DynamicBiasRegressor:
            """The model as it stands on the screen, fitted."""
            assert self.desk.story is not None  # it was made with one
            return self.desk.story.fit().model

    return Widget
