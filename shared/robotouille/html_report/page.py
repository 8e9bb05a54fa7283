"""Content of report pages: sections with tables, figures and lists."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import ClassVar

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from robotouille.html_report.figures import ReportFigure, inline_svg
from robotouille.terminal import printable


@dataclass(frozen=True, slots=True)
class Cell:
    """Table cell that is a link, is code or has a CSS class."""

    text: str
    css: str = ""
    link: str = ""
    code: bool = False


@dataclass(frozen=True, slots=True)
class TableRow:
    """Row of a table. The row of a reference shows published numbers for comparison."""

    cells: tuple[str | Cell, ...]
    reference: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """Table of a report. The first column names the rows.

    Attributes:
        name: Name for files and links.
        note: Explanation above the table.
        words: Columns that contain text. All other columns contain numbers.
        wrap: Break long cells into several lines.
    """

    columns: tuple[str, ...]
    rows: Sequence[TableRow]
    name: str = ""
    title: str = ""
    note: str = ""
    words: frozenset[str] = frozenset()
    wrap: bool = False
    kind: ClassVar[str] = "table"

    def css(self, column: str, cell: str | Cell = "") -> str:
        """Return the CSS classes of a cell."""
        own = cell.css if isinstance(cell, Cell) else ""
        return " ".join(filter(None, ["text" if column in self.words else "", own]))


@dataclass(frozen=True, slots=True)
class FigureGrid:
    """Figures next to each other if the page is wide enough."""

    figures: Sequence[ReportFigure]
    kind: ClassVar[str] = "grid"


@dataclass(frozen=True, slots=True)
class Heading:
    """Heading inside a section, with a remark in small text."""

    text: str
    remark: str = ""
    kind: ClassVar[str] = "heading"


@dataclass(frozen=True, slots=True)
class Details:
    """Blocks that the reader opens with a click."""

    title: str
    remark: str
    blocks: Sequence[Block]
    open: bool = False
    kind: ClassVar[str] = "details"


@dataclass(frozen=True, slots=True)
class Remarks:
    """List of sentences."""

    lines: Sequence[str]
    kind: ClassVar[str] = "remarks"


Block = Table | ReportFigure | FigureGrid | Heading | Details | Remarks


@dataclass(frozen=True, slots=True)
class Section:
    """Section of a page. Text between backticks in the hint is shown as code."""

    id: str
    heading: str
    hint: str
    blocks: Sequence[Block]


@dataclass(frozen=True, slots=True)
class Page:
    """Content of a page.

    Attributes:
        about: The data from which the page was made, below the title.
        cards: The main numbers, each with its unit or meaning.
        notes: Warnings that a reader needs before using the numbers.
    """

    title: str
    about: str
    cards: Sequence[tuple[str, str]]
    notes: Sequence[str]
    sections: Sequence[Section]
    footer: str


FOLDER = Path(__file__).parent


def render_page(page: Page) -> str:
    """Return the HTML of the page. Equal pages give equal text."""
    style = (FOLDER / "page.css").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    policy = f"default-src 'none'; style-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    template = _environment().get_template("page.html.jinja")
    return template.render(page=page, style=Markup(style), policy=policy).lstrip()  # noqa: S704


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(FOLDER),
        autoescape=True,
        finalize=_printable,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters.update(breakable=_breakable, code=_code, svg=_svg)
    return environment


def _printable(value: object) -> object:
    """Remove control characters and direction marks, which the escaping of HTML leaves alone."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _breakable(text: str) -> Markup:
    """Let the browser break a long name after an underscore."""
    return Markup(str(escape(printable(text))).replace("_", "_<wbr>"))  # noqa: S704


def _code(text: str) -> Markup:
    escaped = str(escape(printable(text)))
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", escaped))  # noqa: S704


def _svg(figure: ReportFigure) -> Markup:
    return Markup(inline_svg(figure))  # noqa: S704
