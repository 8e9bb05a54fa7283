"""What happens in a game, as samples of the two streams: pure functions."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from robotouille.program import printable_json
from robotouille_client.sansio.game_events import (
    Announced,
    Changed,
    GameEvent,
    Heard,
    Over,
    RosterChanged,
)

__all__ = ["STEP_CHANNELS", "Channel", "markers", "step_sample"]

Channel = tuple[str, str]
"""A label and a unit."""

STEP_CHANNELS: tuple[Channel, ...] = (
    ("step", "count"),
    ("applied", "count"),
    ("rejected", "count"),
    ("correction", "milliseconds"),
)
"""Of the stream of steps. `correction` is what was taken off the time of arrival."""


def step_sample(event: GameEvent, correction: float) -> list[float] | None:
    """A step, or a whole state that came in place of several; None for anything else.

    Args:
        correction: The seconds that its time stamp is before its arrival.
    """
    if not isinstance(event, Changed):
        return None
    applied = sum(done for _, _, done in event.did)
    return [event.step, applied, len(event.did) - applied, correction * 1000]


def markers(event: GameEvent, step: int) -> Iterator[str]:
    """What happened, as JSON: an action each, and whatever else there is to tell.

    Args:
        step: The step that the game is at.
    """
    for row in _rows(event):
        text = json.dumps({"step": step, **row}, ensure_ascii=False, separators=(",", ":"))
        yield printable_json(text)  # LSL takes no half of a surrogate pair.


def _rows(event: GameEvent) -> Iterator[dict[str, Any]]:
    match event:
        case Changed(did=did):
            for seat, action, applied in did:
                words = [action.name, *action.arguments]
                yield {"event": "action", "seat": seat, "action": words, "applied": applied}
        case RosterChanged(phase=phase, pause=pause):
            reason = {"reason": pause.reason} if pause is not None else {}
            yield {"event": "phase", "phase": phase, **reason}
        case Heard(seat=seat):
            yield {"event": "said", "seat": seat}
        case Announced():
            yield {"event": "announced"}
        case Over(outcome=outcome, reason=reason):
            yield {"event": "over", "reason": outcome.get("reason", reason)}
