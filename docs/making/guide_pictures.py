"""Pictures of the guide, drawn from the code that the guide shows."""

from __future__ import annotations

from pathlib import Path


def draw_all(folder: Path) -> None:
    """Draw every picture into `folder`."""
    folder.mkdir(exist_ok=True)
