"""Figures drawn with matplotlib, and SVG that can be embedded in a page.

Equal input gives equal bytes: files contain neither dates nor random ids.
"""

from __future__ import annotations

import re
import textwrap
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from io import BytesIO, StringIO
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, SOFT, FAINT = "#1e293b", "#64748b", "#cbd5e1"
"""Colours of text, of secondary text and of lines. page.css replaces them in dark mode."""
COLOURS = (
    "#1a80c4", "#d55e00", "#009e73", "#b9629b", "#b08800", "#3a9bd1", "#64748b", "#8c5a2b"
)  # fmt: skip
"""Colours of series, after Okabe and Ito (2008): distinct for all types of colour vision."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",  # Text stays text: it can be selected, and the files are smaller.
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.5,
    "text.color": INK,
    "text.parse_math": False,  # A name with two dollar signs is not a formula.
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
PIXELS_PER_POINT = 1.25
"""Scale of an embedded SVG. At 9.5 points its text has the size of the page's small text."""
WIDE = 540
"""Width in pixels from which a figure scrolls on a phone instead of shrinking."""
MAX_LABEL = 44
SEPARATOR = " · "
LABEL_WIDTH, MAX_LABEL_LINES = 34, 5


@dataclass(frozen=True, slots=True)
class ReportFigure:
    """Figure of a report: file name, caption, SVG text and PNG bytes (empty if not drawn)."""

    name: str
    caption: str
    svg: str
    png: bytes
    kind: ClassVar[str] = "figure"


def draw_figure(
    name: str,
    caption: str,
    size: tuple[float, float],
    draw: Callable[[Figure], None],
    *,
    png: bool = True,
) -> ReportFigure:
    """Return the figure that `draw` draws on a canvas with a size in inches."""
    import matplotlib
    from matplotlib.figure import Figure

    with warnings.catch_warnings(), matplotlib.rc_context({**STYLE, "svg.hashsalt": name}):
        # Matplotlib warns about glyphs that the font lacks and labels that do not fit. Both can
        # come from a participant's name, and the figure is still usable.
        warnings.simplefilter("ignore", UserWarning)
        figure = Figure(figsize=size, layout="constrained")
        draw(figure)
        svg, pixels = StringIO(), BytesIO()
        # Without dates and versions, and with a fixed salt for ids, equal figures are equal files.
        figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
        if png:
            figure.savefig(pixels, format="png", dpi=DPI, metadata={"Software": None})
    return ReportFigure(name, caption, svg.getvalue(), pixels.getvalue())


# Labels, rows and legends


def short_label(text: str, length: int = MAX_LABEL) -> str:
    """Return the text for a label: printable, and cut off after `length` characters."""
    text = "".join(c if c.isprintable() else " " for c in text)
    return text if len(text) <= length else f"{text[: length - 1]}…"


def distinct_labels(names: Iterable[str]) -> dict[str, str]:
    """Return a label of several lines for each name.

    Names consist of parts separated by ` · `. Labels omit the later parts that all names share, and
    the middle of names that are too long. Labels that would be equal get numbers.
    """
    parts = {name: name.split(SEPARATOR) for name in names}
    shared = set.intersection(*map(set, parts.values())) if len(parts) > 1 else set()
    seen, found = Counter[str](), {}
    for name, (first, *more) in parts.items():
        # The first part says whose results they are, also next to other labels.
        text = SEPARATOR.join([first, *(part for part in more if part not in shared)])
        lines = textwrap.wrap(short_label(text, len(text)), LABEL_WIDTH)
        if len(lines) > MAX_LABEL_LINES:
            lines = [*lines[: MAX_LABEL_LINES - 2], "…", lines[-1]]
        label = "\n".join(lines)
        seen[label] += 1
        found[name] = label if seen[label] == 1 else f"{label} #{seen[label]}"
    return found


def label_rows(axes: Axes, labels: Sequence[str], places: Sequence[float] | None = None) -> None:
    """Label the rows of a horizontal chart, the first row at the top."""
    axes.set_yticks(range(len(labels)) if places is None else places, labels)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.grid(visible=True, axis="x")


def legend_above(axes: Axes, columns: int, handles: Sequence[Any] | None = None) -> None:
    """Draw a legend above the axes, where it covers no data."""
    given = {} if handles is None else {"handles": handles, "handlelength": 1, "handleheight": 1}
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=columns, borderaxespad=0,
                columnspacing=1.4, **given)  # fmt: skip


# SVG inside a page


def inline_svg(figure: ReportFigure) -> str:
    """Return the figure as an SVG element for a page.

    Style attributes become presentation attributes: the page's security policy forbids the
    former, and the page's style sheet can override the latter. Ids get the figure's name as a
    prefix because they must be unique in the page.
    """
    svg = figure.svg[figure.svg.index("<svg") :]
    svg = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>|<style.*?</style>", "", svg, flags=re.DOTALL)
    # The first patch is the white background, which would cover the page's colour.
    svg = re.sub(r'<g id="patch_1">.*?</g>', "", svg, count=1, flags=re.DOTALL)
    svg = re.sub(r' style="([^"]*)"', _presentation_attributes, svg)
    svg = re.sub(r'<svg [^>]*?viewBox="0 0 ([\d.]+) [\d.]+"[^>]*>', _opening_tag, svg, count=1)
    prefix = re.sub(r"[^a-z0-9]+", "-", figure.name.casefold())
    return re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{prefix}-", svg).strip()


def _opening_tag(found: re.Match[str]) -> str:
    width = round(float(found[1]) * PIXELS_PER_POINT)
    box = re.search(r'viewBox="[^"]*"', found[0])
    css = ' class="wide"' if width > WIDE else ""
    return f'<svg xmlns:xlink="http://www.w3.org/1999/xlink" width="{width}" {box and box[0]}{css}>'


def _presentation_attributes(found: re.Match[str]) -> str:
    written = []
    for part in found[1].split(";"):
        key, _, value = (piece.strip() for piece in part.partition(":"))
        if key == "font":
            written.append(f'font-size="{value.split("px")[0].split()[-1]}"')
        elif key and key != "font-family":
            written.append(f'{key}="{value}"')
    return "".join(f" {each}" for each in dict.fromkeys(written))
