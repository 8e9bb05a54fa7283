"""Words of the viewer: the line next to the buttons, messages, tooltips and log entries."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pygame

from robotouille.episode.tallies import Activity
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    ACCENT,
    FAINT,
    INK,
    PANEL,
    PAPER,
    TEXT,
    TRACK,
    mixed,
)
from robotouille_client.window.replay.histories.history import Entry, EntryKind, History
from robotouille_client.window.replay.viewer_state import JobProgress, Playhead, ViewerState
from robotouille_client.window.sources.texts import outcome_words, rate_words

MAX_LINES = 6
_STOP = "click to stop"


class Toast:
    """Draws the viewer's message and its jobs, each with a link that stops it."""

    def __init__(self, state: ViewerState) -> None:
        self._state = state
        self._stops: list[tuple[pygame.Rect, Callable[[], None]]] = []
        self._area = pygame.Rect(0, 0, 0, 0)

    def covers(self, position: tuple[int, int]) -> bool:
        """Return whether a pixel is in the card, as drawn last."""
        return self._area.collidepoint(position)

    def redraw_key(self) -> object:
        """Return a value that changes whenever the picture would."""
        jobs = tuple((j.words, j.done and round(j.done, 2)) for j in self._state.jobs.values())
        return self._state.message, jobs

    def draw(
        self, target: pygame.Surface, room: pygame.Rect, text: Typesetter, size: int
    ) -> pygame.Rect:
        """Draw a card in the lower left corner of the room. Return its area."""
        jobs, message = tuple(self._state.jobs.values()), self._state.message
        self._stops = []
        self._area = pygame.Rect(room.bottomleft, (0, 0))
        if not jobs and not message:
            return self._area
        pad, line = size // 2, text.height(size)
        most = min(room.width, 60 * size) - 2 * pad
        lines = text.wrap(message, size, most, MAX_LINES) if message else ()
        bars = line + size
        wide = max(
            [text.width(each, size) for each in lines]
            + [text.width(job.words, size) + _stop_width(text, size) for job in jobs]
            + [min(most, 14 * size)]
        )
        card = pygame.Rect(room.x, 0, min(most, wide) + 2 * pad, 0)
        card.height = len(lines) * line + len(jobs) * bars + pad
        card.bottom = room.bottom
        self._area = card
        target.blit(box(card.size, (*PANEL, 240), 6, ACCENT), card)
        y = card.y + pad // 2
        for each in lines:
            target.blit(text.line(each, size, ACCENT), (card.x + pad, y))
            y += line
        for job in jobs:
            place = pygame.Rect(card.x + pad, y, card.width - 2 * pad, bars)
            self._job(target, place, text, job, size)
            y += bars
        return card

    def _job(
        self,
        target: pygame.Surface,
        area: pygame.Rect,
        text: Typesetter,
        job: JobProgress,
        size: int,
    ) -> None:
        stop = text.line(_STOP, _stop_size(size), FAINT)
        place = stop.get_rect(topright=(area.right, area.y + 2))
        words = text.fit(job.words, size, area.width - _stop_width(text, size))
        target.blit(text.line(words, size, TEXT), area)
        target.blit(stop, place)
        pygame.draw.line(target, FAINT, (place.x, place.bottom), (place.right, place.bottom))
        self._stops.append((place.inflate(size, size // 2), job.stop))
        bar = pygame.Rect(area.x, area.bottom - size * 3 // 4, area.width, max(3, size // 3))
        target.fill(INK, bar)
        if job.done is None:
            target.fill(TRACK, bar)
        else:
            target.fill(ACCENT, (*bar.topleft, round(bar.width * min(1.0, job.done)), bar.height))

    def press(self, position: tuple[int, int]) -> bool:
        """Handle a click. Return whether it stopped a job."""
        for place, stop in self._stops:
            if place.collidepoint(position):
                stop()
                return True
        return False


def time_words(milliseconds: int) -> str:
    """Return a time as `24.0 s`, or as `1:24` from a minute on."""
    seconds = milliseconds / 1000
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def name_of(history: History, player: str, step: int) -> str:
    """Return the name of a seat's participant, or else the player."""
    names = {seat.player: seat.name for seat in history.seats(step)}
    return names.get(player) or player


def entry_words(entry: Entry) -> str:
    """Return an event in words, without its player."""
    match entry.kind:
        case EntryKind.REJECTED:
            why = "; ".join(entry.reasons)
            return f"rejected: {entry.words}" + (f" ({why})" if why else "")
        case EntryKind.SUPERSEDED:
            return f"changed plans: {entry.words}"
        case EntryKind.SAID:
            return f"“{entry.words}”"
        case EntryKind.REASONING:
            return f"thinking: {entry.words}"
        case EntryKind.ANNOUNCED:
            return f"the operator: {entry.words}"
    return entry.words


_HINT = "H: help · Esc: leave"


def readout_parts(history: History, playhead: Playhead, state: ViewerState) -> tuple[str, ...]:
    """Return the line's parts, the most important first: `Step 12 of 345`, `2.4 s`, `1×, …`."""
    step = min(playhead.step, history.length)
    speed = f"{playhead.speed:g}×, {rate_words(playhead.rate * playhead.speed)}"
    if playhead.follows:
        how = "live" if history.outcome is None else "ended"
    elif playhead.playing:
        how = speed
    else:
        how = f"paused ({playhead.speed:g}×)"
    words = [f"Step {step} of {history.length}", time_words(history.times[step]), how]
    if history.outcome is not None and step == history.length:
        words.insert(1, outcome_words(history.outcome))
    if playhead.live and not playhead.follows:
        over = history.outcome is not None
        words.append("ended: press End to see how" if over else "press End for live")
    if state.followed:
        words.append(f"following {name_of(history, state.followed, step)}")
    if state.first is not None or state.last is not None:
        first, last = state.span(history.length)
        words.append(f"clip {first} to {last}")
    return tuple(words)


def draw_readout(
    target: pygame.Surface,
    area: pygame.Rect,
    text: Typesetter,
    size: int,
    parts: tuple[str, ...],
    *,
    ended: bool,
) -> None:
    """Draw as many parts as fit, and a hint at the help.

    Args:
        ended: True if the second part says how the game ended.
    """
    shown = list(parts)
    while len(shown) > 1 and text.width(" · ".join(shown), size) > area.width:
        shown.pop()
    if text.width(shown[0], size) > area.width:
        shown = [shown[0].removeprefix("Step ").replace(" of ", " / ")]
    x = area.x
    for place, part in enumerate(shown):
        words = part if place == len(shown) - 1 else f"{part} · "
        ink = ACCENT if ended and place == 1 else TEXT
        drawn = text.line(text.fit(words, size, max(1, area.right - x)), size, ink)
        target.blit(drawn, drawn.get_rect(midleft=(x, area.centery)))
        x += text.width(words, size)
    hint = text.line(_HINT, max(9, size - 4), FAINT)
    if hint.get_width() + size <= area.right - x:
        target.blit(hint, hint.get_rect(midright=area.midright))


# Events in a tooltip.
MAX_TOLD = 5
# Width of a tooltip, as a multiple of the text size.
MAX_WIDTH = 26
_DOES = {
    Activity.ACTED: "acted",
    Activity.BUSY: "was busy",
    Activity.WAITING: "was waiting or rejected",
    Activity.IDLE: "did nothing",
    Activity.AWAY: "was away",
    Activity.SUBSTITUTED: "had a substitute",
}


def summary_at(history: History, step: int, player: str | None, left: str) -> list[str]:
    """Return lines about a step: its number and time, what a seat did, and what happened.

    Args:
        player: Seat to describe; None describes all events.
        left: Known steps to go, in words.
    """
    step = min(step, history.length)
    head = f"Step {step} · {time_words(history.times[step])}{f' · {left}' if left else ''}"
    if player is None:
        entries = history.entries(step)
        lines = [_line(history, entry.player, step, entry_words(entry)) for entry in entries]
    else:
        entries = tuple(e for e in history.entries(step) if e.player in (player, ""))
        lines = [f"{name_of(history, player, step)} {_does(history, player, step)}"]
        lines += map(entry_words, entries)
    more = [f"and {len(lines) - MAX_TOLD} more"] if len(lines) > MAX_TOLD else []
    return [head, *lines[:MAX_TOLD], *more]


def _does(history: History, player: str, step: int) -> str:
    if not step:
        return "has not started"
    did = history.activity(player, step)
    return "was not seen" if did is None else _DOES[did]


def _line(history: History, player: str, step: int, words: str) -> str:
    return f"{name_of(history, player, step)}: {words}" if player else words


def draw_tooltip(
    target: pygame.Surface,
    room: pygame.Rect,
    at: tuple[int, int],
    words: Sequence[str],
    text: Typesetter,
    size: int,
) -> None:
    """Draw a card above a point, within the room; the first line is the heading."""
    small, pad = max(10, size - 1), size // 2
    most = max(size, min(room.width - 2 * size, MAX_WIDTH * size))
    lines = [line for each in words for line in text.wrap(each, small, most, 2)]
    high = text.height(small)
    width = max(text.width(line, small) for line in lines) + 2 * pad
    card = pygame.Rect(0, 0, width, high * len(lines) + pad)
    card.midbottom = at
    card.clamp_ip(room)
    target.blit(box(card.size, (*INK, 240), 6, mixed(INK, PAPER, 0.4)), card)
    for i, line in enumerate(lines):
        drawn = text.line(line, small, ACCENT if i == 0 else TEXT)
        target.blit(drawn, (card.x + pad, card.y + pad // 2 + i * high))


def _stop_size(size: int) -> int:
    return max(9, size - 2)


def _stop_width(text: Typesetter, size: int) -> int:
    """Return the width of the link that stops a job, with its distance from the words."""
    return text.width(_STOP, _stop_size(size)) + size
