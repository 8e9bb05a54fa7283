"""What stands on a report's page, and in what order: cards, notes and sections."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from robotouille_client.console.pages.page import figure_html, notes_html
from robotouille_data.answers.report import tables
from robotouille_data.answers.report.facts import Facts, Progress
from robotouille_data.answers.report.figures import MAX_POINTS, all_figures
from robotouille_data.answers.report.grouping import MAX_GROUPS, Group, Groups
from robotouille_data.answers.report.html import (
    MAX_LISTED,
    Section,
    chat_html,
    recordings_html,
    table_html,
)
from robotouille_data.answers.report.time_lines import (
    MAX_SHOWN,
    MAX_STEPS,
    TimeLine,
    draw_time_lines,
)

__all__ = ["Material", "cards", "notes", "sections"]


@dataclass(frozen=True, slots=True)
class Material:
    """What a page is made of; `time_lines` are of the groups that are shown, in their order."""

    facts: Facts
    groups: Groups
    time_lines: Sequence[Sequence[TimeLine]]
    by: str
    text: bool
    folder: Path

    @property
    def shown(self) -> Sequence[Group]:
        return self.groups.shown

    @property
    def said(self) -> int:
        """Messages of all seats in the groups that are shown."""
        return sum(seat.said for group in self.shown for seat in group.seats)


def cards(material: Material) -> Iterator[tuple[str, str]]:
    """Numbers of episodes, each with what it counts."""
    episodes, facts = material.facts.episodes, material.facts
    yield f"{len(episodes):,}", "episode" if len(episodes) == 1 else "episodes"
    for group in material.shown[:4]:
        yield f"{len(group.episodes):,}", f"{material.by}: {group.name}"
    unfinished = sum(each.state != "ended" for each in episodes)
    yield f"{unfinished:,}", "unfinished"
    yield f"{facts.unknown:,}", "asked for and missing"
    yield f"{facts.damaged:,}", "damaged recordings"


def notes(material: Material) -> Iterator[str]:
    """What one has to know before one believes a number."""
    facts = material.facts
    unlabelled = sum(each.group is None for each in facts.episodes)
    if unlabelled:
        yield f"{_counted(unlabelled, 'episode')} without a label “{material.by}”"
    if facts.unknown:
        yield f"{_counted(facts.unknown, 'episode')} that the query names and the catalogue has not"
    if facts.damaged:
        named = "; ".join(f"{Path(path).name}: {fault}" for path, fault in facts.faults[:3])
        yield (
            f"{_counted(facts.damaged, 'recording')} of the catalogue that could not be read, in no"
            f" number here, whichever the label: {named}"
        )
    if len({each.task for each in facts.episodes}) > 1:
        yield "these are several tasks: steps of one do not compare with those of another"
    if len({each.clock for each in facts.episodes}) > 1:
        yield "these are several clocks: times to decide mean different things in them"
    delayed = [seat for seat in facts.seats if seat.delay_ms]
    if delayed:
        longest = max(seat.delay_ms for seat in delayed)
        yield (
            f"{_counted(len(delayed), 'seat')} whose actions the study held back, by {longest:,} "
            "ms at most: the delay is in their times to decide"
        )


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def sections(material: Material, progress: Progress) -> Iterator[Section]:
    """The parts of the page, in their order."""
    shown, by = material.shown, material.by
    progress("figures", 0, 1)
    figures = {name: figure_html(picture) for name, picture in all_figures(shown).items()}
    progress("figures", 1, 1)

    def with_figures(table: tables.Table, *names: str) -> list[str]:
        return [*(figures.get(name, "") for name in names), table_html(table)]

    yield Section(
        "episodes", "Episodes", f"How many there are, by the label “{by}”.",
        with_figures(tables.episodes_table(material.groups, by)),
    )  # fmt: skip
    yield Section(
        "outcomes", "Outcomes",
        "Intervals that lie apart are hardly chance; those that overlap much leave it open. Those "
        "of success take episodes as independent: if pairs play several, they are wider in truth. "
        "An optimality rate is steps by the fewest steps that are possible, for tasks of which "
        "these are known: 1 is best.",
        with_figures(tables.outcomes_table(shown, by), "outcomes"),
    )  # fmt: skip
    yield Section(
        "activities", "What seats did",
        "High idle shares are time in which somebody could have acted; waiting is time in which "
        "they tried. Steps of a stand-in are not its person's. Refused, lost and said are counted "
        "for a seat in an episode, on average.",
        with_figures(tables.activities_table(shown, by), "activities"),
    )  # fmt: skip
    yield Section(
        "spread", "Idle and decision times",
        "Medians over seats, with 95 % intervals by bootstrap; all seats of a pair are drawn "
        "together, as they are alike. In real time the time to decide has in it "
        "the time in which one only watched.",
        with_figures(tables.spread_table(shown, by), "idle", "decisions"),
    )  # fmt: skip
    yield _rounds(material, figures)
    yield _time_lines(material)
    yield _chat(material)
    yield Section(
        "interruptions", "Absences and interruptions",
        "An absence is a participant whose connection was lost, or who left. What their seat did "
        "meanwhile are steps away, or those of a stand-in.",
        with_figures(tables.interruptions_table(shown, material.facts, by)),
    )  # fmt: skip
    yield Section(
        "recordings", "Recordings",
        "Paths are as seen from the folder of this page. robotouille replay play shows a recording "
        "in a window, replay notes lists what happened, replay verify plays it again.",
        [recordings_html(group, material.folder) for group in shown],
    )  # fmt: skip
    missing = notes_html(list(_left_out(material)))
    yield Section("left-out", "What is not shown, and why", "", [missing])


def _rounds(material: Material, figures: Mapping[str, str]) -> Section:
    if "rounds" not in figures:
        hint = "Not shown: it takes a label “round” with at least two numbers."
        return Section("rounds", "Learning over rounds", hint, [])
    hint = (
        "A line that falls on the left is a group that becomes faster. Not every pair need have "
        "played every round: the table has how many did."
    )
    table = table_html(tables.rounds_table(material.shown, material.by))
    return Section("rounds", "Learning over rounds", hint, [figures["rounds"], table])


def _time_lines(material: Material) -> Section:
    content: list[str] = []
    steps = [line.episode.steps for lines in material.time_lines for line in lines]
    for place, (group, lines) in enumerate(zip(material.shown, material.time_lines, strict=True)):
        if not lines:
            continue
        left = len(group.episodes) - len(lines)
        note = f", {left:,} more are not drawn" if left else ""
        heading = (
            f"<h3>{escape(group.name)} <small>{_counted(len(lines), 'episode')}{note}</small></h3>"
        )
        drawn = draw_time_lines(f"course {place}", lines, max(steps))
        content.append(heading + figure_html(drawn))
    hint = (
        "Long stretches of one colour on both lanes are time in which nothing went on; ticks close "
        "together are somebody who wanted what could not be done."
    )
    return Section("time-lines", "Time lines", hint, content)


def _chat(material: Material) -> Section:
    if not material.text:
        return Section("chat", "Chat", "Left out, as was asked for (--no-text).", [])
    found = [
        chat_html(group, lines)
        for group, lines in zip(material.shown, material.time_lines, strict=True)
    ]
    if not any(found):
        return Section("chat", "Chat", "Nothing was said in the episodes above.", [])
    hint = (
        f"{material.said:,} messages in all; here are those of the episodes whose time lines are "
        "drawn. When is seconds since the game began."
    )
    return Section("chat", "Chat", hint, found)


def _left_out(material: Material) -> Iterator[str]:
    shown, groups = material.shown, material.groups
    if groups.left_out:
        count = sum(groups.left_out.values())
        yield (
            f"{_counted(len(groups.left_out), 'group')} of “{material.by}” with "
            f"{_counted(count, 'episode')}: there is room for the {MAX_GROUPS} largest"
        )
    pairs = zip(shown, material.time_lines, strict=True)
    left = sum(len(group.episodes) - len(lines) for group, lines in pairs)
    if left:
        yield (
            f"time lines and chat of {_counted(left, 'episode')}: of each group {MAX_SHOWN} are "
            f"drawn, each pair's first ones, and none of more than {MAX_STEPS:,} steps"
        )
    if any(len(group.episodes) > MAX_LISTED for group in shown):
        yield f"links to all recordings: the first {MAX_LISTED} of each group are listed"
    if max(len(group.seats) for group in shown) > MAX_POINTS:
        yield f"every dot: of more than {MAX_POINTS} in a line so many are drawn, by lot"
    ended = Counter(each.optimality is None for g in shown for each in g.episodes if each.success)
    if ended[True]:
        yield (
            f"an optimality rate of {ended[True]:,} successes: the fewest steps of their tasks are "
            "not known"
        )
    yield "seats in which nobody ever acted, in the figure of times to decide"
    yield "tests of significance: which is right depends on how the study was planned"
