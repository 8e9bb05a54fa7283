"""From a catalogue to a page in a file."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

from sqlalchemy.engine import URL

from robotouille.domain.files import whole_file
from robotouille.errors import MissingExtraError
from robotouille_data.answers.query import SECONDS, reading
from robotouille_data.answers.report.facts import Progress, read_facts
from robotouille_data.answers.report.grouping import grouped
from robotouille_data.answers.report.html import Page, render_page
from robotouille_data.answers.report.sections import Material, cards, notes, sections
from robotouille_data.answers.report.time_lines import read_time_lines
from robotouille_data.answers.selection import check_label, select_episodes

__all__ = ["BY", "write_report"]

BY = "condition"
"""The label that is compared, if nothing else is said."""


def write_report(
    url: URL,
    path: Path,
    *,
    query: str | None = None,
    labels: Mapping[str, str] | None = None,
    by: str = BY,
    text: bool = True,
    title: str = "Robotouille: a first look",
    seconds: float = SECONDS,
    progress: Progress = lambda what, done, total: None,
) -> int:
    """Write the page of some episodes; how many there are. The same catalogue, the same bytes.

    Args:
        url: Of the catalogue.
        path: Of the page. Recordings are named as seen from its folder.
        query: Whose column `id` or `episode_id` says which episodes; all without one.
        labels: Only episodes that have all of these.
        by: The label whose values are compared.
        text: Also what was said.
        seconds: How long the query may take.

    Raises:
        MissingExtraError: Matplotlib is not installed.
        UnavailableError: The database cannot be read now.
        CatalogueError: There is no catalogue of this version, the query is none, or there is no
            such episode or label.
        OSError: The page cannot be written; what was there before stays.
    """
    if not all(map(find_spec, ("matplotlib", "numpy"))):
        raise MissingExtraError("a report", "data")
    with reading(url) as connection:
        selection = select_episodes(connection, url, query, labels, seconds=seconds)
        if by != BY:
            check_label(connection, by)
        facts = read_facts(connection, selection, by, progress)
        groups = grouped(facts)
        time_lines = []
        for place, group in enumerate(groups.shown):
            progress("time lines", place, len(groups.shown))
            time_lines.append(read_time_lines(connection, group))
    material = Material(facts, groups, time_lines, by, text, path.absolute().parent)
    page = Page(
        title,
        _about(query, labels),
        list(cards(material)),
        list(notes(material)),
        list(sections(material, progress)),
    )
    with whole_file(path) as file:
        file.write(render_page(page))
    return len(facts.episodes)


def _about(query: str | None, labels: Mapping[str, str] | None) -> str:
    asked = "all episodes" if query is None else f"episodes of the query {' '.join(query.split())}"
    only = " and ".join(f"{name} = {value}" for name, value in (labels or {}).items())
    return f"{asked}, with {only}" if only else asked
