"""One line above the lanes: whether it plays, where one is, how fast, what else goes on."""

from __future__ import annotations

import pygame

from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, BAD, FAINT, TEXT
from robotouille_client.window.replay.history.history import ACTIVITIES, History
from robotouille_client.window.replay.playhead import Playhead
from robotouille_client.window.replay.timeline.lanes import ACTIVITY_LOOKS, ACTIVITY_WORDS
from robotouille_client.window.replay.timeline.words import name_of, time_words
from robotouille_client.window.replay.viewer_state import ViewerState

__all__ = ["draw_legend", "draw_readout", "readout_words"]


def readout_words(history: History, playhead: Playhead, state: ViewerState) -> str:
    """`Step 12 of 345 · 2.4 s · 1×, 5 steps a second`."""
    step = min(playhead.step, history.length)
    speed = f"{playhead.speed:g}×, {playhead.rate * playhead.speed:g} steps a second"
    if playhead.follows:
        how = "live"
    elif playhead.playing:
        how = speed
    else:
        how = f"paused ({playhead.speed:g}×)"
    words = [f"Step {step} of {history.length}", time_words(history.times[step]), how]
    if playhead.live and not playhead.follows:
        words.append("End goes back to live")
    if state.followed:
        words.append(f"following {name_of(history, state.followed, step)}")
    if state.first is not None or state.last is not None:
        first, last = state.span(history.length)
        words.append(f"span {first} to {last}")
    return " · ".join(words)


def draw_readout(
    target: pygame.Surface,
    area: pygame.Rect,
    text: Typesetter,
    size: int,
    history: History,
    playhead: Playhead,
    state: ViewerState,
) -> pygame.Rect:
    """The line, with a button that plays and pauses; where the button is."""
    side = max(8, size)
    button = pygame.Rect(area.x + size // 2, 0, side, side)
    button.centery = area.centery
    _draw_button(target, button, playhead)
    left = button.right + size // 2
    room = area.right - left - size
    words = text.fit(readout_words(history, playhead, state), size, room)
    drawn = text.line(words, size, TEXT)
    target.blit(drawn, drawn.get_rect(midleft=(left, area.centery)))
    left += drawn.get_width() + size
    beside = pygame.Rect(left, area.y, area.right - left - size // 2, area.height)
    if state.message:
        if beside.width < 12 * size:
            beside = pygame.Rect(button.right, area.y, area.right - button.right - 4, area.height)
            target.fill(target.get_at((area.x + 1, area.y + 3)), beside)
        told = text.line(text.fit(state.message, size, beside.width), size, ACCENT)
        target.blit(told, told.get_rect(midright=(beside.right, area.centery)))
    else:
        draw_legend(target, beside, text, max(9, size - 4))
    return button.inflate(size, size // 2)


def _draw_button(target: pygame.Surface, button: pygame.Rect, playhead: Playhead) -> None:
    """A round dot while it is live, two bars while it plays, a triangle while it does not."""
    if playhead.follows:
        pygame.draw.circle(target, BAD, button.center, button.width // 2 - 1)
    elif playhead.playing:
        bar = max(2, button.width // 3)
        for x in (button.x + 1, button.right - bar - 1):
            target.fill(ACCENT, (x, button.y + 1, bar, button.height - 2))
    else:
        points = [(button.x + 1, button.y), (button.x + 1, button.bottom), button.midright]
        pygame.draw.polygon(target, ACCENT, points)


def draw_legend(target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int) -> None:
    """What the blocks in the lanes mean, as far as there is room; then how to get help."""
    right = area.right
    hint = text.line("H: keys", size, FAINT)
    if hint.get_width() > area.width:
        return
    target.blit(hint, hint.get_rect(midright=(right, area.centery)))
    right -= hint.get_width() + size * 3 // 2
    parts = [
        (activity, text.line(ACTIVITY_WORDS[activity], size, FAINT)) for activity in ACTIVITIES
    ]
    wide = sum(words.get_width() + size * 3 // 2 for _, words in parts)
    if right - wide < area.left:
        return
    x = right - wide
    for activity, words in parts:
        colour, high = ACTIVITY_LOOKS[activity]
        height = max(2, round(size * high))
        target.fill(colour, (x, area.centery + size // 2 - height, size // 2, height))
        x += size * 2 // 3
        target.blit(words, words.get_rect(midleft=(x, area.centery)))
        x += words.get_width() + size * 5 // 6
