"""Progress of long work, and its threads."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

from threadpoolctl import ThreadpoolController

_controller: ThreadpoolController | None = None


def one_blas_thread() -> Any:
    """Context in which BLAS uses one thread."""
    global _controller
    if _controller is None:
        _controller = ThreadpoolController()
    return _controller.limit(limits=1, user_api="blas")


Progress = Callable[[str], None] | bool | None
"""What a parameter `progress` takes: a function that is called with a line of text before each piece of work; True for
a bar (extra "progress"); None or False for nothing."""


def has_bars() -> bool:
    """True if bars can be drawn."""
    return find_spec("tqdm") is not None


@contextmanager
def reporting(progress: Progress, total: int | None = None) -> Iterator[Callable[[str], None]]:
    """A function that reports each piece of work.

    `progress` (callable, bool or None). `total` (int, optional): Pieces of work; without it a bar shows the time that
    has passed alone. Raises ValueError for something else. Raises ImportError for a bar without the package that
    draws it.
    """
    if callable(progress):
        yield progress
    elif progress is None or progress is False:
        yield lambda text: None
    elif progress is not True:
        raise ValueError(
            f"The 'progress' parameter must be True (a bar), a function of one text, or None. Got {progress!r} instead."
        )
    else:
        with _bar(total) as bar:
            yield bar


@contextmanager
def _bar(total: int | None) -> Iterator[Callable[[str], None]]:
    """A progress bar, where somebody sees it."""
    try:
        from tqdm.auto import tqdm
    except ImportError:
        raise ImportError(
            "A bar is drawn by tqdm, which is not installed: pip install tqdm. Or pass a function, "
            "such as progress=print."
        ) from None
    notebook = "ipykernel" in sys.modules
    begun = 0
    with tqdm(total=total, leave=False, disable=None if not notebook else False, file=sys.stderr) as bar:

        def begin(text: str) -> None:
            nonlocal begun
            bar.update(1 if begun else 0)  # the piece before is done now
            begun += 1
            bar.set_description(text)

        yield begin
        if begun:
            bar.update(1)
