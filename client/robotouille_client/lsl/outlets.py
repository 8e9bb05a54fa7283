"""Two outlets of LSL: the steps as numbers, and what happened as text."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any, Protocol

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille.program import printable
from robotouille.release import RELEASE
from robotouille_client.lsl.samples import STEP_CHANNELS, Channel, markers, step_sample
from robotouille_client.sansio.game_events import GameEvent, RosterChanged

__all__ = ["Outlet", "Outlets", "load_pylsl", "open_outlets"]


MAX_WORDS = 500
"""Letters of what a stream says of itself: all who look for streams are told."""


class Outlet(Protocol):
    """Takes samples: see `pylsl.StreamOutlet`."""

    def push_sample(self, x: list[Any], timestamp: float) -> None:
        """A sample, and when it was, by LSL's clock."""


class Outlets:
    """Both streams of one game.

    Args:
        clock: LSL's clock, in seconds.
    """

    def __init__(self, steps: Outlet, events: Outlet, clock: Callable[[], float]) -> None:
        self._steps = steps
        self._events = events
        self._clock = clock
        self._stood: tuple[str, str | None] | None = None

    def push(self, event: GameEvent, step: int, correction: float) -> None:
        """What has just arrived, at the time at which the server sent it.

        Args:
            step: The step that the game is at.
            correction: The seconds that it was under way.
        """
        stamp = self._clock() - correction
        sample = step_sample(event, correction)
        if sample is not None:
            self._steps.push_sample(sample, stamp)
        if isinstance(event, RosterChanged):
            stands = event.phase, event.pause.reason if event.pause else None
            if stands == self._stood:
                return
            self._stood = stands
        for marker in markers(event, step):
            self._events.push_sample([marker], stamp)


def load_pylsl() -> ModuleType:
    """The library.

    Raises:
        MissingExtraError: It is not installed.
        RobotouilleError: Its own library for this system is missing.
    """
    try:
        import pylsl
    except ImportError:
        raise MissingExtraError("robotouille-lsl", "lsl") from None
    except RuntimeError as error:
        raise RobotouilleError(str(error).strip().partition("\n")[0]) from None
    module: ModuleType = pylsl
    return module


def open_outlets(
    pylsl: ModuleType, episode: str, task: str, url: str, offsets: list[float]
) -> Outlets:
    """Two outlets that can be found by their source ids `robotouille-EPISODE-steps` and
    `robotouille-EPISODE-events`.

    Args:
        offsets: Seconds that messages were under way, as measured before.
    """

    about = {"episode": episode, "task": task, "url": url}
    # Of what a server words LSL takes text alone, and XML has no control characters.
    about = {name: printable(value)[:MAX_WORDS] for name, value in about.items()}

    def outlet(what: str, kind: str, channels: tuple[Channel, ...], form: Any) -> Any:
        info = pylsl.StreamInfo(
            f"Robotouille {what}",
            kind,
            len(channels),
            pylsl.IRREGULAR_RATE,
            form,
            f"robotouille-{about['episode']}-{what}",
        )
        _describe(info.desc(), channels, about, offsets)
        return pylsl.StreamOutlet(info)

    return Outlets(
        outlet("steps", "Steps", STEP_CHANNELS, pylsl.cf_double64),
        outlet("events", "Markers", (("event", "JSON"),), pylsl.cf_string),
        pylsl.local_clock,
    )


def _describe(
    description: Any, channels: tuple[Channel, ...], about: dict[str, str], offsets: list[float]
) -> None:
    """The names of XDF's metadata, as far as it has some."""
    rows = description.append_child("channels")
    for label, unit in channels:
        row = rows.append_child("channel")
        row.append_child_value("label", label)
        row.append_child_value("unit", unit)
    synchronization = description.append_child("synchronization")
    synchronization.append_child_value("time_source", "arrival minus half a round trip")
    synchronization.append_child_value("offset_mean", f"{sum(offsets) / len(offsets):.6f}")
    synchronization.append_child_value("offset_min", f"{min(offsets):.6f}")
    synchronization.append_child_value("offset_max", f"{max(offsets):.6f}")
    synchronization.append_child_value("can_drop_samples", "false")
    acquisition = description.append_child("acquisition")
    for name, value in {"software": RELEASE, **about}.items():
        acquisition.append_child_value(name, value)
