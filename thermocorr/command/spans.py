"""Time spans among the options of a command."""

from __future__ import annotations


def number_or_span(text: str) -> float | str:
    """Seconds as a number; a span such as 15s, or a word, as it stands."""
    try:
        return float(text)
    except ValueError:
        return text
