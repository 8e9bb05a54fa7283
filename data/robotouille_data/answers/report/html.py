"""The report as one HTML page that needs nothing else: no script, and nothing from anywhere."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from os.path import relpath
from pathlib import Path
from urllib.parse import quote

from robotouille.release import RELEASE
from robotouille_client.console.pages.page import (
    cards_html,
    escaped,
    notes_html,
    page_html,
    scrolling_table,
)
from robotouille_client.console.pages.page_style import STYLE
from robotouille_data.answers.report.facts import Episode
from robotouille_data.answers.report.grouping import Group
from robotouille_data.answers.report.tables import Table
from robotouille_data.answers.report.time_lines import MAX_SAID, TimeLine

__all__ = [
    "MAX_LISTED",
    "Page",
    "Section",
    "chat_html",
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
FOOTER = (
    f"Made by Robotouille {RELEASE} from a catalogue of recordings; the same catalogue gives the "
    "same page. What each number means: docs/data.md. This is a first look: nothing here is a "
    "test, and intervals of several comparisons are each their own."
)


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
    first = (
        f'<section id="first">{cards_html(page.cards)}{notes_html(page.notes, "notes")}</section>'
    )
    return page_html(
        page.title,
        page.about,
        [(each.id, each.heading) for each in page.sections],
        sections_html="\n".join([first, *map(_section, page.sections)]),
        footer=FOOTER,
        style=OWN_STYLE,
    )


def _section(section: Section) -> str:
    hint = f'<p class="hint">{escaped(section.hint)}</p>' if section.hint else ""
    inner = "".join(section.content)
    return f'<section id="{section.id}"><h2>{escaped(section.heading)}</h2>{hint}{inner}</section>'


def table_html(table: Table, kind: str = "") -> str:
    """A table that can be scrolled."""
    text = [name in table.text for name in table.columns]
    marks = [' class="text"' if words else "" for words in text]
    rows = "".join(_row(row, marks) for row in table.rows)
    return scrolling_table([escaped(name) for name in table.columns], rows, text, kind)


def _row(row: Sequence[str], marks: Sequence[str]) -> str:
    cells = "".join(
        f"<td{mark}>{escaped(cell)}</td>" for cell, mark in zip(row[1:], marks[1:], strict=True)
    )
    return f'<tr><th scope="row">{escaped(row[0])}</th>{cells}</tr>'


def _fold(title: str, small: str, content: str, state: str = "") -> str:
    """Something that is opened by a click, or `open` from the first."""
    head = f"{escaped(title)} <small>{escaped(small)}</small>"
    return f"<details{state}><summary>{head}</summary>{content}</details>"


# Chat and recordings


def chat_html(group: Group, time_lines: Sequence[TimeLine]) -> str:
    """What was said in some episodes of a group, each folded but the first; empty where nothing
    was."""
    talks = [time_line for time_line in time_lines if time_line.said]
    return "".join(_chat(group, talk, "" if place else " open") for place, talk in enumerate(talks))


def _chat(group: Group, time_line: TimeLine, state: str) -> str:
    rows = tuple(
        (f"{each.t / 1000:,.1f} s", each.name or _seat(each.seat), each.text)
        for each in time_line.said
    )
    table = Table(("when", "who", "what"), rows, frozenset({"who", "what"}))
    count = f"{time_line.messages:,} message{'' if time_line.messages == 1 else 's'}"
    if time_line.messages > MAX_SAID:
        count += f", the first {MAX_SAID} of them"
    return _fold(f"{group.name}: {time_line.episode.name}", count, table_html(table, "said"), state)


def _seat(seat: int | None) -> str:
    return "a spectator" if seat is None else f"seat {seat}"


def recordings_html(group: Group, folder: Path) -> str:
    """The recordings of a group's first episodes, with links as seen from a folder."""
    listed = group.episodes[:MAX_LISTED]
    columns = ("episode", "pair", "round", "result", "steps", "watch it")
    body = "".join(_recording(each, folder) for each in listed)
    count = f"{len(group.episodes):,} episode{'s' * (len(group.episodes) != 1)}"
    if len(listed) < len(group.episodes):
        count += f", the first {len(listed)} of them"
    text = [name in ("pair", "result", "watch it") for name in columns]
    return _fold(group.name, count, scrolling_table(columns, body, text))


def _recording(episode: Episode, folder: Path) -> str:
    if episode.path is None:
        name, command = escaped(episode.name), ""
    else:
        near = relpath(episode.path, folder)
        name = f'<a href="{escape(quote(near))}">{escaped(episode.name)}</a>'
        command = f"<code>{escaped(f'robotouille replay play {shlex.quote(near)}')}</code>"
    result = (episode.reason or episode.state).replace("_", " ")
    won = ' class="text won"' if episode.success else ' class="text lost"'
    return (
        f'<tr><th scope="row">{name}</th><td class="text">{escaped(episode.pair or "")}</td>'
        f"<td>{escaped(episode.round or '')}</td><td{won}>{escaped(result)}</td>"
        f'<td>{episode.steps:,}</td><td class="text">{command}</td></tr>'
    )
