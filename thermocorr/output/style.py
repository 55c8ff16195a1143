"""One palette and one style, light and dark; SVG."""

from __future__ import annotations

import hashlib
import io
import re
from typing import Any

PALETTE = {
    "ground": ("#ffffff", "#12161d"),
    "box": ("#f5f6f8", "#1b212b"),
    "grid": ("#e6e9ef", "#28303c"),
    "line": ("#d3d8e0", "#3a4453"),
    "text": ("#1b212c", "#e4e8ef"),
    "soft": ("#5a6475", "#a0abbd"),
    "pale": ("#b4bdca", "#566275"),
    "blue": ("#0072b2", "#5db4f0"),
    "vermilion": ("#d55e00", "#ff8f4d"),
    "green": ("#00795a", "#46cfa2"),
    "orange": ("#e69f00", "#f2ba45"),
    "sky": ("#56b4e9", "#3f83b3"),
    "purple": ("#b3588f", "#e3a3c8"),
    "yellow": ("#f0e442", "#9c8f1e"),
}
"""Colour -> on light and on dark ground. After Okabe and Ito, whose colours colour-blind readers can tell apart."""
GROUND, GRID, TEXT, SOFT, PALE = (PALETTE[name][0] for name in ("ground", "grid", "text", "soft", "pale"))
BLUE, VERMILION, GREEN, ORANGE, SKY, PURPLE, YELLOW = (
    PALETTE[name][0] for name in ("blue", "vermilion", "green", "orange", "sky", "purple", "yellow")
)
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
"""For curves that are compared."""
STYLE: dict[Any, Any] = {
    "figure.facecolor": GROUND,
    "axes.facecolor": GROUND,
    "savefig.facecolor": GROUND,
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "legend.fontsize": 9.0,
    "legend.frameon": False,
    "text.color": TEXT,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": TEXT,
    "axes.titlecolor": TEXT,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelcolor": TEXT,
    "ytick.labelcolor": TEXT,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "text.parse_math": False,  # names are their writers'
    "svg.fonttype": "none",
}
"""Style of matplotlib for every picture."""


def css() -> str:
    """The palette as variables of a style sheet."""
    light, dark = ("".join(f"--{name}:{both[k]};" for name, both in PALETTE.items()) for k in (0, 1))
    return (
        f":root{{color-scheme:light dark;{light}}}\n"
        f"@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}\n"
        ".picture{display:block;width:100%;height:auto;font-family:inherit}\n"
        ".picture *{stroke-linejoin:round}\n"
    )


def svg_of(figure: Any, label: str) -> str:
    """A figure as ``<svg>`` in the colours of its page.

    No style, script or address is in it, and coordinates have one decimal. Equal figures give equal text.
    """
    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    text = text[text.index("<svg") :].replace("\n", " ")
    text = re.sub(r"<(metadata|style).*?</\1>|<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r' style="([^"]*)"', lambda found: _attributes(found[1]), text)
    text = re.sub(r' d="([^"]*)"', lambda found: f' d="{_short(found[1])}"', text)
    text = re.sub(r">\s+<", "><", text)
    used = {name: str(k) for k, name in enumerate(dict.fromkeys(re.findall(r'(?:href="|url\()#([^")]+)', text)))}
    text = re.sub(r' id="([^"]+)"', lambda found: f' id="#{used[found[1]]}"' if found[1] in used else "", text)
    text = re.sub(r'(href="|url\()#([^")]+)', lambda found: f"{found[1]}#{used[found[2]]}", text)
    unique = hashlib.sha256(text.encode()).hexdigest()[:8]  # two pictures of one page have no name in common
    text = text.replace(' id="#', f' id="{unique}-').replace('href="#', f'href="#{unique}-')
    text = text.replace("url(#", f"url(#{unique}-")
    size = re.search(r'viewBox="[^"]*"', text)
    assert size is not None
    head = f'<svg class="picture" role="img" aria-label="{label}" {size[0]} xmlns="http://www.w3.org/2000/svg" '
    return head + 'xmlns:xlink="http://www.w3.org/1999/xlink">' + text[text.index(">") + 1 :].strip() + "\n"


def _attributes(style: str) -> str:
    """A style as attributes, colours by name."""
    names = {both[0]: f"var(--{name})" for name, both in PALETTE.items()}
    said = []
    for part in filter(None, map(str.strip, style.split(";"))):
        name, value = map(str.strip, part.split(":", 1))
        if name == "font":  # its family is the page's
            size = re.search(r"[\d.]+px", value)
            said += [("font-size", size[0])] if size else []
            said += [("font-weight", "bold")] if re.search(r"\b(bold|700)\b", value) else []
        else:
            said.append((name, names.get(value.lower(), value)))
    return "".join(f' {name}="{value}"' for name, value in said if name != "font-family")


def _short(path: str) -> str:
    """A path with one decimal, and upright strokes by their end."""
    path = re.sub(r"-?\d+\.\d+", lambda found: f"{float(found[0]):.1f}".removesuffix(".0"), path)
    path = re.sub(r"M (\S+) (\S+)\s+L \1 (\S+)(?=\s+M|\s*$)", r"M\1 \2V\3", path)
    return re.sub(r"\s+", " ", path).strip()
