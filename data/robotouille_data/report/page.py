"""HTML page of a report on a catalogue."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from os.path import relpath
from pathlib import Path
from urllib.parse import quote

from sqlalchemy.engine import URL

from robotouille.files.writing import whole_file
from robotouille.html_report import require_libraries
from robotouille.html_report.figures import ReportFigure
from robotouille.html_report.page import (
    Block,
    Cell,
    Details,
    Heading,
    Page,
    Remarks,
    Section,
    Table,
    TableRow,
)
from robotouille.installation import RELEASE
from robotouille_data.query import SECONDS, check_label, reading, select_episodes
from robotouille_data.report import tables
from robotouille_data.report.facts import (
    MAX_GROUPS,
    EpisodeFacts,
    Facts,
    Group,
    Groups,
    Progress,
    grouped,
    read_facts,
)
from robotouille_data.report.figures import MAX_POINTS, all_figures
from robotouille_data.report.time_lines import (
    MAX_SAID,
    MAX_SHOWN,
    MAX_STEPS,
    TimeLine,
    draw_time_lines,
    read_time_lines,
)

BY = "condition"
"""Label that is compared by default."""
MAX_LISTED = 100
"""Recordings listed for each group."""
FOOTER = (
    f"Made by {RELEASE} from a catalogue of recordings. The same catalogue gives the "
    "same page. docs/data.md defines the numbers. This page is a first look: it contains no "
    "significance tests, and its intervals are not corrected for multiple comparisons."
)


@dataclass(frozen=True, slots=True)
class ReportOptions:
    """Choice of episodes, and content of the page.

    Attributes:
        query: SQL with a column `id` or `episode_id` that selects episodes. None selects all.
        labels: Labels that the episodes must have.
        by: Label whose values are compared.
        text: Show chat messages.
        seconds: Time limit of the query.
    """

    query: str | None = None
    labels: Mapping[str, str] = field(default_factory=dict)
    by: str = BY
    text: bool = True
    title: str = "Robotouille: a first look"
    seconds: float = SECONDS


DEFAULT_OPTIONS = ReportOptions()


def write_report(
    url: URL,
    path: Path,
    options: ReportOptions = DEFAULT_OPTIONS,
    progress: Progress = lambda stage, done, total: None,
) -> int:
    """Write a page on a catalogue's episodes, and return their number.

    The same catalogue gives the same bytes. The page refers to recordings relative to its folder.

    Raises:
        MissingExtraError: A library for pages or figures is not installed.
        UnavailableError: The database cannot be read now.
        CatalogueError: There is no catalogue of this version, the query is invalid, or no episode
            or label matches.
        OSError: The page cannot be written. An existing page remains as it was.
    """
    require_libraries("a report", "data")
    from robotouille.html_report.page import render_page

    with reading(url) as connection:
        selection = select_episodes(
            connection, url, options.query, options.labels, seconds=options.seconds
        )
        if options.by != BY:
            check_label(connection, options.by)
        facts = read_facts(connection, selection, options.by, progress)
        groups = grouped(facts)
        time_lines = []
        for place, group in enumerate(groups.shown):
            progress("time lines", place, len(groups.shown))
            time_lines.append(read_time_lines(connection, group))
    # Everything is read in one snapshot of the catalogue, so that all numbers of the page agree
    # while an indexer writes.
    content = _Content(facts, groups, time_lines, options, path.absolute().parent)
    page = Page(
        options.title,
        _about(options),
        list(content.cards()),
        list(content.notes()),
        list(content.sections(progress)),
        FOOTER,
    )
    with whole_file(path) as file:
        file.write(render_page(page))
    return len(facts.episodes)


def _about(options: ReportOptions) -> str:
    query = options.query
    chosen = "all episodes" if query is None else f"episodes of the query {' '.join(query.split())}"
    labels = " and ".join(f"{name} = {value}" for name, value in options.labels.items())
    return f"{chosen}, with {labels}" if labels else chosen


def _with_figures(figures: Mapping[str, ReportFigure], table: Table, *names: str) -> list[Block]:
    """Return the figures that exist, then their table."""
    return [*(figures[name] for name in names if name in figures), table]


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


@dataclass(frozen=True, slots=True)
class _Content:
    """Content of a page. `time_lines` has a list for each group that is shown."""

    facts: Facts
    groups: Groups
    time_lines: Sequence[Sequence[TimeLine]]
    options: ReportOptions
    folder: Path

    def cards(self) -> Iterator[tuple[str, str]]:
        facts = self.facts
        yield f"{len(facts.episodes):,}", "episode" if len(facts.episodes) == 1 else "episodes"
        for group in self.groups.shown[:4]:
            yield f"{len(group.episodes):,}", f"{self.options.by}: {group.name}"
        yield f"{sum(each.state != 'ended' for each in facts.episodes):,}", "unfinished"
        yield f"{facts.unknown:,}", "in the query but not in the catalogue"
        yield f"{facts.damaged:,}", "damaged recordings"

    def notes(self) -> Iterator[str]:
        """Yield the warnings that a reader needs before using the numbers."""
        facts, by = self.facts, self.options.by
        unlabelled = sum(each.group is None for each in facts.episodes)
        if unlabelled:
            yield f"{_counted(unlabelled, 'episode')} without a label “{by}”"
        if facts.unknown:
            yield f"{_counted(facts.unknown, 'episode')} of the query missing from the catalogue"
        if facts.damaged:
            named = "; ".join(f"{Path(path).name}: {fault}" for path, fault in facts.faults)
            yield (
                f"{_counted(facts.damaged, 'recording')} of the catalogue could not be read and "
                f"count nowhere on this page: {named}"
            )
        if len({each.task for each in facts.episodes}) > 1:
            yield "the episodes have different tasks, whose steps cannot be compared"
        if len({each.clock for each in facts.episodes}) > 1:
            yield "the episodes have different clocks, whose decision times cannot be compared"
        delays = [seat.delay_ms for seat in facts.seats if seat.delay_ms]
        if delays:
            yield (
                f"the study delayed the actions of {_counted(len(delays), 'seat')} by up to "
                f"{max(delays):,} ms; their decision times include the delay"
            )

    def sections(self, progress: Progress) -> Iterator[Section]:
        progress("figures", 0, 1)
        figures = all_figures(self.groups.shown)
        progress("figures", 1, 1)
        yield from self._results(figures)
        yield from self._behaviour(figures)
        yield from self._events()
        yield Section("left-out", "Omissions", "", [Remarks(list(self._omitted()))])

    def _results(self, figures: Mapping[str, ReportFigure]) -> Iterator[Section]:
        shown, by = self.groups.shown, self.options.by
        yield Section(
            "episodes", "Episodes", f"Number of episodes by the label “{by}”.",
            [tables.episodes_table(self.groups, by)],
        )  # fmt: skip
        yield Section(
            "outcomes", "Outcomes",
            "If two intervals do not overlap, chance alone is an unlikely reason for the "
            "difference. If they overlap much, the data leave the question open. The intervals of "
            "success assume independent episodes, so they are too narrow if a pair plays several. "
            "The optimality rate is steps / fewest steps, for tasks whose shortest plan is known; "
            "1 is best.",
            _with_figures(figures, tables.outcomes_table(shown, by), "outcomes"),
        )  # fmt: skip
        if any(each.score is not None for group in shown for each in group.episodes):
            yield Section(
                "scores", "Scores of shifts",
                "Shifts have no goal, so they are not in the table above. Points and their share "
                "of the upper bound are medians with 95 % bootstrap intervals. The upper bound "
                "counts every order as served in the step after its arrival.",
                [tables.scores_table(shown, by)],
            )  # fmt: skip

    def _behaviour(self, figures: Mapping[str, ReportFigure]) -> Iterator[Section]:
        shown, by = self.groups.shown, self.options.by
        yield Section(
            "activities", "Activities",
            "Idle: the seat could act but had no action. Waiting: its action was rejected, it was "
            "another player's turn, or a bot declared that it waits. People cannot declare a wait, "
            "so compare the sum of both between people and bots. Steps of a substitute do not "
            "count for the participant. Rejected and lost actions and messages are means per seat "
            "and episode.",
            _with_figures(figures, tables.activities_table(shown, by), "activities"),
        )  # fmt: skip
        yield Section(
            "spread", "Inactive shares and decision times",
            "Medians over seats with 95 % bootstrap intervals. Inactive: idle or waiting, the same "
            "for people and bots. Could act usefully: the part of it in which some action of the "
            "seat would have left less work (only after `data index --useful`). The seats of a "
            "pair are correlated, so the bootstrap draws pairs. In real time, a decision time "
            "includes the time in which the participant only watched.",
            _with_figures(figures, tables.spread_table(shown, by), "idle", "decisions"),
        )  # fmt: skip
        if "rounds" in figures:
            yield Section(
                "rounds", "Learning over rounds",
                "A falling line on the left is a group that becomes faster. Pairs may have played "
                "different numbers of rounds; the table has the counts.",
                _with_figures(figures, tables.rounds_table(shown, by), "rounds"),
            )  # fmt: skip
        else:
            hint = "Not shown: this section needs a label “round” with at least two numbers."
            yield Section("rounds", "Learning over rounds", hint, [])

    def _events(self) -> Iterator[Section]:
        shown, by = self.groups.shown, self.options.by
        yield Section(
            "time-lines", "Time lines",
            "A long stretch of one colour on both lanes is time without progress. Many ticks in a "
            "row are repeated attempts at an action that is not possible.",
            list(self._time_lines()),
        )  # fmt: skip
        yield self._chat()
        yield Section(
            "interruptions", "Absences and interruptions",
            "A participant is absent after losing the connection or leaving. The seat is then "
            "away, or a substitute plays it.",
            [tables.interruptions_table(shown, self.facts, by)],
        )  # fmt: skip
        yield Section(
            "recordings", "Recordings",
            "Paths are relative to the folder of this page. `robotouille replay play` shows a "
            "recording, `replay notes` lists its events, and `replay verify` simulates it again.",
            [_recordings(group, self.folder) for group in shown],
        )  # fmt: skip

    def _time_lines(self) -> Iterator[Block]:
        steps = [line.episode.steps for lines in self.time_lines for line in lines]
        for place, (group, lines) in enumerate(
            zip(self.groups.shown, self.time_lines, strict=True)
        ):
            if lines:
                left = len(group.episodes) - len(lines)
                note = f", {left:,} more are not drawn" if left else ""
                yield Heading(group.name, _counted(len(lines), "episode") + note)
                yield draw_time_lines(f"time lines {place}", lines, max(steps))

    def _chat(self) -> Section:
        if not self.options.text:
            return Section("chat", "Chat", "Left out because of `--no-text`.", [])
        talks = [
            _talk(group, line, first=place == 0)
            for group, lines in zip(self.groups.shown, self.time_lines, strict=True)
            for place, line in enumerate(each for each in lines if each.said)
        ]
        if not talks:
            return Section("chat", "Chat", "There are no messages in the episodes above.", [])
        total = sum(seat.said for group in self.groups.shown for seat in group.seats)
        hint = (
            f"Messages of the episodes with a time line, of {total:,} messages in all. Times are "
            "in seconds since the start of the episode."
        )
        return Section("chat", "Chat", hint, talks)

    def _omitted(self) -> Iterator[str]:
        shown, groups = self.groups.shown, self.groups
        if groups.left_out:
            yield (
                f"{_counted(len(groups.left_out), 'group')} of “{self.options.by}” with "
                f"{_counted(sum(groups.left_out.values()), 'episode')}: there is room for the "
                f"{MAX_GROUPS} largest"
            )
        pairs = zip(shown, self.time_lines, strict=True)
        left = sum(len(group.episodes) - len(lines) for group, lines in pairs)
        if left:
            yield (
                f"time lines and chat of {_counted(left, 'episode')}: {MAX_SHOWN} are drawn for "
                f"each group, the first episodes of each pair, and none with more than "
                f"{MAX_STEPS:,} steps"
            )
        if any(len(group.episodes) > MAX_LISTED for group in shown):
            yield f"links to all recordings: the first {MAX_LISTED} of each group are listed"
        if max(len(group.seats) for group in shown) > MAX_POINTS:
            yield f"dots beyond {MAX_POINTS} in a row, which are a random sample"
        won = [each for group in shown for each in group.episodes if each.success]
        if unknown := sum(each.optimality is None for each in won):
            yield (
                f"the optimality rate of {unknown:,} successes: the shortest plans of their tasks "
                "are not known"
            )
        yield "seats that never acted, in the figure of decision times"
        yield "significance tests: the right test depends on the plan of the study"


def _talk(group: Group, line: TimeLine, *, first: bool) -> Details:
    rows = [
        TableRow((f"{each.t / 1000:,.1f} s", each.name or _seat_name(each.seat), each.text))
        for each in line.said
    ]
    remark = _counted(line.messages, "message")
    if line.messages > MAX_SAID:
        remark += f", the first {MAX_SAID} of them"
    words = frozenset({"name", "message"})
    table = Table(("time", "name", "message"), rows, words=words, wrap=True)
    return Details(f"{group.name}: {line.episode.name}", remark, [table], first)


def _seat_name(seat: int | None) -> str:
    return "a spectator" if seat is None else f"seat {seat}"


def _recordings(group: Group, folder: Path) -> Details:
    listed = group.episodes[:MAX_LISTED]
    rows = [_recording(each, folder) for each in listed]
    remark = _counted(len(group.episodes), "episode")
    if len(listed) < len(group.episodes):
        remark += f", the first {len(listed)} of them"
    columns = ("episode", "pair", "round", "result", "steps", "command")
    words = frozenset({"pair", "result", "command"})
    return Details(group.name, remark, [Table(columns, rows, words=words)])


def _recording(episode: EpisodeFacts, folder: Path) -> TableRow:
    near = "" if episode.path is None else relpath(episode.path, folder)
    command = f"robotouille replay play {shlex.quote(near)}" if near else ""
    result = (episode.reason or episode.state).replace("_", " ")
    if episode.score is not None:
        result += f", {episode.score.points:,} points"
    css = "won" if episode.success else "lost" if episode.score is None else ""
    return TableRow((
        Cell(episode.name, link=quote(near)), episode.pair or "", episode.round or "",
        Cell(result, css=css), f"{episode.steps:,}",
        Cell(command, code=bool(command)),
    ))  # fmt: skip
