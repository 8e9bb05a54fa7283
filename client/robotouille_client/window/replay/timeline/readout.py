"""One line beside the buttons: where one is, how fast it goes, what is marked, how it ended."""

from __future__ import annotations

import pygame

from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, FAINT, TEXT
from robotouille_client.window.replay.history.history import History
from robotouille_client.window.replay.playhead import Playhead
from robotouille_client.window.replay.timeline.words import name_of, time_words
from robotouille_client.window.replay.viewer_state import ViewerState
from robotouille_client.window.sources.texts import outcome_words, rate_words

__all__ = ["draw_readout", "readout_parts"]

_HINT = "H: keys and colours · Esc: leave"


def readout_parts(history: History, playhead: Playhead, state: ViewerState) -> tuple[str, ...]:
    """`Step 12 of 345`, `2.4 s`, `1×, 5 steps a second`: the most important first."""
    step = min(playhead.step, history.length)
    speed = f"{playhead.speed:g}×, {rate_words(playhead.rate * playhead.speed)}"
    if playhead.follows:
        how = "live" if history.outcome is None else "over"
    elif playhead.playing:
        how = speed
    else:
        how = f"paused ({playhead.speed:g}×)"
    words = [f"Step {step} of {history.length}", time_words(history.times[step]), how]
    if history.outcome is not None and step == history.length:
        words.insert(1, outcome_words(history.outcome))
    if playhead.live and not playhead.follows:
        over = history.outcome is not None
        words.append("it is over: End shows how" if over else "End goes back to live")
    if state.followed:
        words.append(f"following {name_of(history, state.followed, step)}")
    if state.first is not None or state.last is not None:
        first, last = state.span(history.length)
        words.append(f"span {first} to {last}")
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
    """As many parts as there is room for, and how to get help.

    Args:
        ended: The second part says how it ended.
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
