"""Drawing with matplotlib: style, files, and SVG that can stand inside a page.

Equal input gives equal bytes: no dates, no random ids.
"""

from __future__ import annotations

import re
import textwrap
import warnings
from collections import Counter
from collections.abc import Callable, Iterable
from io import BytesIO, StringIO
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "COLOURS",
    "FAINT",
    "INK",
    "SOFT",
    "Picture",
    "distinct_labels",
    "drawn",
    "inline_svg",
    "plain",
]

INK, SOFT, FAINT = "#1e293b", "#64748b", "#cbd5e1"
"""Text, what is of less weight, and lines. A page swaps them in the dark."""
COLOURS = ("#2563eb", "#ea580c", "#059669", "#9333ea", "#db2777", "#0891b2", "#ca8a04", "#dc2626")
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.5,
    "text.color": INK,
    "text.parse_math": False,
    "axes.labelcolor": INK,
    "axes.edgecolor": FAINT,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}
DPI = 160
MAX_LABEL = 44
SEPARATOR = " · "
LINE, MAX_LINES = 34, 5
"""Letters of a line of a label, and its lines."""


class Picture(NamedTuple):
    """A figure of a report: the name of its files, what it shows, and both formats (no PNG where
    none was asked for)."""

    name: str
    caption: str
    svg: str
    png: bytes


def plain(text: str, length: int = MAX_LABEL) -> str:
    """A label that can be drawn: printable, and not too long."""
    text = "".join(c if c.isprintable() else " " for c in text)
    return text if len(text) <= length else f"{text[: length - 1]}…"


def distinct_labels(names: Iterable[str]) -> dict[str, str]:
    """A label for each name, of some lines: what all names share is left out, and of what is too
    long all the same the middle. Where two would look alike, they have numbers.

    Names are of parts with ` · ` between them.
    """
    parts = {name: name.split(SEPARATOR) for name in names}
    shared = set.intersection(*map(set, parts.values())) if len(parts) > 1 else set()
    seen, found = Counter[str](), {}
    for name, own in parts.items():
        text = SEPARATOR.join([part for part in own if part not in shared] or own)
        lines = textwrap.wrap(plain(text, len(text)), LINE)
        if len(lines) > MAX_LINES:
            lines = [*lines[: MAX_LINES - 2], "…", lines[-1]]
        label = "\n".join(lines)
        seen[label] += 1
        found[name] = label if seen[label] == 1 else f"{label} #{seen[label]}"
    return found


def drawn(
    name: str,
    caption: str,
    size: tuple[float, float],
    draw: Callable[[Figure], None],
    *,
    png: bool = True,
) -> Picture:
    """The picture that a function draws on a figure of some inches."""
    import matplotlib
    from matplotlib.figure import Figure

    with warnings.catch_warnings(), matplotlib.rc_context({**STYLE, "svg.hashsalt": name}):
        warnings.simplefilter("ignore", UserWarning)  # letters it has not, labels without room
        figure = Figure(figsize=size, layout="constrained")
        draw(figure)
        svg, pixels = StringIO(), BytesIO()
        figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
        if png:
            figure.savefig(pixels, format="png", dpi=DPI, metadata={"Software": None})
    return Picture(name, caption, svg.getvalue(), pixels.getvalue())


def inline_svg(picture: Picture) -> str:
    """A picture as an element of a page.

    Style attributes become attributes of their own, since the page's policy forbids them and its
    own style then can override colours. Ids are the document's, so they get the picture's name.
    """
    svg = picture.svg[picture.svg.index("<svg") :]
    svg = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>|<style.*?</style>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'<g id="patch_1">.*?</g>', "", svg, count=1, flags=re.DOTALL)  # the paper
    svg = re.sub(r' style="([^"]*)"', _attributes, svg)
    svg = re.sub(r'<svg [^>]*?viewBox="0 0 ([\d.]+) [\d.]+"[^>]*>', _opening, svg, count=1)
    prefix = re.sub(r"[^a-z0-9]+", "-", picture.name.casefold())
    return re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{prefix}-", svg).strip()


WIDE = 540
"""Pixels below which a phone lets one scroll a picture rather than shrink it."""


def _opening(found: re.Match[str]) -> str:
    """The element's opening tag: as wide as drawn, and no higher than that makes it."""
    width = round(float(found[1]) * 1.25)
    box = re.search(r'viewBox="[^"]*"', found[0])
    kind = ' class="wide"' if width > WIDE else ""
    return (
        f'<svg xmlns:xlink="http://www.w3.org/1999/xlink" width="{width}" {box and box[0]}{kind}>'
    )


def _attributes(found: re.Match[str]) -> str:
    written = []
    for part in found[1].split(";"):
        key, _, value = (piece.strip() for piece in part.partition(":"))
        if key == "font":
            written.append(f'font-size="{value.split("px")[0].split()[-1]}"')
        elif key and key != "font-family":
            written.append(f'{key}="{value}"')
    return "".join(f" {each}" for each in dict.fromkeys(written))
