"""What a fitted model refuses of later rows, as JSON and back."""

from __future__ import annotations

from typing import Any

from ..records.grammar import LARGEST
from ..records.screen import MOST_KEPT, Limits, Screen
from .codec import LARGEST_INTEGER, fields, items, number, unexpected

QUANTITIES = ("temperature", "reading")
MOST_CODES = 2 * MOST_KEPT


def pack_screen(screen: Screen) -> dict[str, Any]:
    """Codes and spikes of both quantities; a spike is its time stamp and its value."""
    return {what: pack_limits(getattr(screen, what)) for what in QUANTITIES}


def pack_limits(limits: Limits) -> dict[str, Any]:
    """What is refused of one quantity."""
    spikes = [[stamp, value] for stamp, value in limits.spikes.items()]
    return {"middle": limits.middle, "codes": list(limits.codes), "spikes": spikes}


def unpack_screen(node: Any, where: str) -> Screen:
    """The screen, every number checked."""
    node = fields(node, where, QUANTITIES)
    return Screen(**{what: unpack_limits(node[what], f"{where}.{what}") for what in QUANTITIES})


def unpack_limits(node: Any, where: str) -> Limits:
    """What is refused of one quantity, checked."""
    node = fields(node, where, ("middle", "codes", "spikes"))
    codes = [number(code, f"{where}.codes[{i}]") for i, code in enumerate(items(node["codes"], f"{where}.codes"))]
    if len(codes) > MOST_CODES or any(abs(code) > LARGEST for code in codes):
        raise unexpected(f"{where}.codes", f"{len(codes)} codes", f"at most {MOST_CODES}, none beyond {LARGEST:g}")
    spikes = {}
    for i, item in enumerate(items(node["spikes"], f"{where}.spikes")):
        place = f"{where}.spikes[{i}]"
        stamp, value = items(item, place, 2)
        if type(stamp) is int:
            if abs(stamp) > LARGEST_INTEGER:
                raise unexpected(f"{place}[0]", str(stamp)[:60], "a time")
        else:
            number(stamp, f"{place}[0]")
        spikes[stamp] = number(value, f"{place}[1]")
    if len(spikes) > MOST_KEPT:
        raise unexpected(f"{where}.spikes", f"{len(spikes)} spikes", f"at most {MOST_KEPT}")
    return Limits(middle=number(node["middle"], f"{where}.middle"), codes=tuple(codes), spikes=spikes)
