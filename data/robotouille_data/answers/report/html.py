"""The report as one HTML page that needs nothing else: no script, and nothing from anywhere."""

from __future__ import annotations

import base64
import hashlib
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from os.path import relpath
from pathlib import Path
from string import Template
from urllib.parse import quote

from robotouille.program import printable
from robotouille.release import RELEASE
from robotouille_client.console.pages.drawing import Picture, inline_svg
from robotouille_client.console.pages.page_style import STYLE
from robotouille_data.answers.report.facts import Episode
from robotouille_data.answers.report.grouping import Group
from robotouille_data.answers.report.tables import Table
from robotouille_data.answers.report.time_lines import MAX_SAID, Course

__all__ = [
    "MAX_LISTED",
    "Page",
    "Section",
    "chat_html",
    "figure_html",
    "notes_html",
    "recordings_html",
    "render_page",
    "table_html",
]

MAX_LISTED = 100
"""Recordings of a group that are listed."""
OWN_STYLE = (
    STYLE
    + """
.said td:nth-child(2), .said td:nth-child(3) { text-align: left; white-space: normal; }
.said td:nth-child(3) { overflow-wrap: anywhere; width: 70%; }
.group { font-weight: 600; }
section { break-inside: auto; }
@media print { :root { --back: #fff; } main { max-width: none; padding: 0; }
  nav { display: none; } figure, .card, tr { break-inside: avoid; } h2, h3 { break-after: avoid; }
  details { content-visibility: visible; }
  details::details-content { content-visibility: visible; block-size: auto; }
  td, th { padding: 4px 8px; } }
"""
)
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
<section id="first"><div class="cards">$cards</div>$notes</section>
$sections
<footer><p>Made by Robotouille $release from a catalogue of recordings; the same catalogue gives \
the same page. What each number means: docs/data.md. This is a first look: nothing here is a test, \
and intervals of several comparisons are each their own.</p></footer>
</main>
</body>
</html>
""")


@dataclass(frozen=True, slots=True)
class Section:
    """A part of the page: its id, its heading, what it means in words, and its HTML."""

    id: str
    heading: str
    hint: str
    content: Sequence[str]


@dataclass(frozen=True, slots=True)
class Page:
    """What is on a page: cards are a number and what it counts; notes what one has to know."""

    title: str
    about: str
    cards: Sequence[tuple[str, str]]
    notes: Sequence[str]
    sections: Sequence[Section]


def render_page(page: Page) -> str:
    """The page's HTML; equal pages give equal text."""
    digest = base64.b64encode(hashlib.sha256(OWN_STYLE.encode()).digest()).decode()
    return PAGE.substitute(
        title=_words(page.title),
        style=OWN_STYLE,
        style_hash=f"sha256-{digest}",
        about=_words(page.about),
        links="".join(f'<a href="#{each.id}">{_words(each.heading)}</a>' for each in page.sections),
        cards="".join(
            f'<div class="card"><b>{_words(value)}</b><span>{_words(name)}</span></div>'
            for value, name in page.cards
        ),
        notes=notes_html(page.notes, ' class="notes"'),
        sections="\n".join(map(_section, page.sections)),
        release=_words(RELEASE),
    )


def _words(text: str) -> str:
    """Somebody else's words, as a page may show them."""
    return escape(printable(text))


def _section(section: Section) -> str:
    hint = f'<p class="hint">{_words(section.hint)}</p>' if section.hint else ""
    inner = "".join(section.content)
    return f'<section id="{section.id}"><h2>{_words(section.heading)}</h2>{hint}{inner}</section>'


def notes_html(notes: Sequence[str], kind: str = "") -> str:
    """A list of sentences; nothing without any."""
    lines = "".join(f"<li>{_words(note)}</li>" for note in notes)
    return f"<ul{kind}>{lines}</ul>" if lines else ""


def figure_html(picture: Picture) -> str:
    """A figure with its caption."""
    caption = f"<figcaption>{escape(picture.caption)}</figcaption>"
    return f"<figure><div>{inline_svg(picture)}</div>{caption}</figure>"


def table_html(table: Table, kind: str = "") -> str:
    """A table that can be scrolled."""
    marks = [' class="text"' if name in table.text else "" for name in table.columns]
    head = "".join(
        f'<th scope="col"{mark}>{_words(name)}</th>'
        for name, mark in zip(table.columns, marks, strict=True)
    )
    body = "".join(_row(row, marks) for row in table.rows)
    return (
        f'<div class="table{kind}" tabindex="0"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def _row(row: Sequence[str], marks: Sequence[str]) -> str:
    cells = "".join(
        f"<td{mark}>{_words(cell)}</td>" for cell, mark in zip(row[1:], marks[1:], strict=True)
    )
    return f'<tr><th scope="row">{_words(row[0])}</th>{cells}</tr>'


def _fold(title: str, small: str, content: str, state: str = "") -> str:
    """Something that is opened by a click, or `open` from the first."""
    head = f"{_words(title)} <small>{_words(small)}</small>"
    return f"<details{state}><summary>{head}</summary>{content}</details>"


# Chat and recordings


def chat_html(group: Group, courses: Sequence[Course]) -> str:
    """What was said in some episodes of a group, each folded but the first; empty where nothing
    was."""
    talks = [course for course in courses if course.said]
    return "".join(_chat(group, talk, "" if place else " open") for place, talk in enumerate(talks))


def _chat(group: Group, course: Course, state: str) -> str:
    rows = tuple(
        (f"{each.t / 1000:,.1f} s", each.name or _seat(each.seat), each.text)
        for each in course.said
    )
    table = Table(("when", "who", "what"), rows, frozenset({"who", "what"}))
    count = f"{course.messages:,} message{'' if course.messages == 1 else 's'}"
    if course.messages > MAX_SAID:
        count += f", the first {MAX_SAID} of them"
    return _fold(f"{group.name}: {course.episode.name}", count, table_html(table, " said"), state)


def _seat(seat: int | None) -> str:
    return "a spectator" if seat is None else f"seat {seat}"


def recordings_html(group: Group, folder: Path) -> str:
    """The recordings of a group's first episodes, with links as seen from a folder."""
    listed = group.episodes[:MAX_LISTED]
    columns = ("episode", "pair", "round", "result", "steps", "watch it")
    head = "".join(f'<th scope="col"{_kind(name)}>{name}</th>' for name in columns)
    body = "".join(_recording(each, folder) for each in listed)
    count = f"{len(group.episodes):,} episodes"
    if len(listed) < len(group.episodes):
        count += f", the first {len(listed)} of them"
    return _fold(
        group.name,
        count,
        f'<div class="table" tabindex="0"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>",
    )


def _kind(column: str) -> str:
    return ' class="text"' if column in ("pair", "result", "watch it") else ""


def _recording(episode: Episode, folder: Path) -> str:
    if episode.path is None:
        name, command = _words(episode.name), ""
    else:
        near = relpath(episode.path, folder)
        name = f'<a href="{escape(quote(near))}">{_words(episode.name)}</a>'
        command = f"<code>{_words(f'robotouille replay play {shlex.quote(near)}')}</code>"
    result = (episode.reason or episode.state).replace("_", " ")
    won = ' class="text won"' if episode.success else ' class="text lost"'
    return (
        f'<tr><th scope="row">{name}</th><td class="text">{_words(episode.pair or "")}</td>'
        f"<td>{_words(episode.round or '')}</td><td{won}>{_words(result)}</td>"
        f'<td>{episode.steps:,}</td><td class="text">{command}</td></tr>'
    )
