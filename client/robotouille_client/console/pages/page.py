"""The frame of a report's page: one file that needs nothing else, without a script.

The page's policy allows its own style and nothing more, so that a name which slips through does
nothing. Texts are escaped here; what is called `html` is put in as it is.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Sequence
from html import escape
from string import Template

from robotouille.program import printable
from robotouille_client.console.pages.drawing import Picture, inline_svg

__all__ = ["cards_html", "escaped", "figure_html", "notes_html", "page_html", "scrolling_table"]

PAGE = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src '$style_hash'; \
base-uri 'none'; form-action 'none'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="referrer" content="no-referrer">
<title>$title</title>
<style>$style</style>
</head>
<body>
<main>
<header>
<h1>$title</h1>
<p class="about">$about</p>
<nav>$links</nav>
</header>
$sections
<footer><p>$footer</p></footer>
</main>
</body>
</html>
""")


def escaped(text: str) -> str:
    """Somebody else's words, as a page may show them."""
    return escape(printable(text))


def page_html(
    title: str,
    about: str,
    links: Iterable[tuple[str, str]],
    *,
    sections_html: str,
    footer: str,
    style: str,
) -> str:
    """A page.

    Args:
        about: What it is made of.
        links: To its sections: their ids and headings.
        style: CSS; its hash is in the policy.
    """
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    return PAGE.substitute(
        title=escaped(title),
        style=style,
        style_hash=f"sha256-{digest}",
        about=escaped(about),
        links="".join(f'<a href="#{key}">{escaped(heading)}</a>' for key, heading in links),
        sections=sections_html,
        footer=escaped(footer),
    )


def cards_html(cards: Iterable[tuple[str, str]]) -> str:
    """Numbers, each with what it counts."""
    inner = "".join(
        f'<div class="card"><b>{escaped(value)}</b><span>{escaped(name)}</span></div>'
        for value, name in cards
    )
    return f'<div class="cards">{inner}</div>'


def notes_html(notes: Iterable[str], kind: str = "") -> str:
    """A list of sentences; nothing without any."""
    mark = f' class="{kind}"' if kind else ""
    lines = "".join(f"<li>{escaped(note)}</li>" for note in notes)
    return f"<ul{mark}>{lines}</ul>" if lines else ""


def figure_html(picture: Picture) -> str:
    """A figure with its caption."""
    caption = f"<figcaption>{escape(picture.caption)}</figcaption>"
    return f"<figure><div>{inline_svg(picture)}</div>{caption}</figure>"


def scrolling_table(
    headings_html: Sequence[str], rows_html: str, text: Sequence[bool], kind: str = ""
) -> str:
    """A table that can be scrolled.

    Args:
        text: Which columns hold words; all others hold numbers.
        kind: Classes of its own.
    """
    marks = (' class="text"' if words else "" for words in text)
    head = "".join(
        f'<th scope="col"{mark}>{heading}</th>'
        for heading, mark in zip(headings_html, marks, strict=True)
    )
    own = f" {kind}" if kind else ""
    return (
        f'<div class="table{own}" tabindex="0"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{rows_html}</tbody></table></div>"
    )
