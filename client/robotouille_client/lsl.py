"""Command `robotouille-lsl`: stream an episode to the Lab Streaming Layer (extra `lsl`)."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from types import ModuleType
from typing import Annotated, Any, Protocol

import typer

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille.installation import RELEASE
from robotouille.terminal import options_from, printable, printable_json, tell
from robotouille_client.client import Client, connect
from robotouille_client.console import (
    ServerOptions,
    VersionOption,
    failing,
    interruptible,
    unicode,
)
from robotouille_client.errors import ConnectionFailedError
from robotouille_client.game import Game
from robotouille_client.sansio.game_events import (
    Announced,
    ChatReceived,
    GameEnded,
    GameEvent,
    RosterChanged,
    StateChanged,
)

Channel = tuple[str, str]
"""A label and its unit."""

STEP_CHANNELS: tuple[Channel, ...] = (
    ("step", "count"),
    ("applied", "count"),
    ("rejected", "count"),
    ("correction", "milliseconds"),
)
"""Channels of the step stream. `correction` was subtracted from the time of arrival."""


def step_sample(event: GameEvent, correction: float) -> list[float] | None:
    """Return the sample of a step or snapshot, or None for other events.

    Args:
        correction: Seconds between the time stamp and the arrival.
    """
    if not isinstance(event, StateChanged):
        return None
    applied = sum(done for _, _, done in event.did)
    return [event.step, applied, len(event.did) - applied, correction * 1000]


def markers(event: GameEvent, step: int) -> Iterator[str]:
    """Yield the markers of an event as JSON, one for each action.

    Args:
        step: The current step of the game.
    """
    for row in _rows(event):
        # Programs may record a marker for hours, and a hostile server's texts have megabytes.
        short = {name: _shortened(value) for name, value in row.items()}
        text = json.dumps({"step": step, **short}, ensure_ascii=False, separators=(",", ":"))
        yield printable_json(text)  # LSL cannot encode half of a surrogate pair.


def _shortened(value: Any) -> Any:
    if isinstance(value, list):
        return [word[:MAX_WORDS] for word in value]
    return value[:MAX_WORDS] if isinstance(value, str) else value


def _rows(event: GameEvent) -> Iterator[dict[str, Any]]:
    match event:
        case StateChanged(did=did):
            for seat, action, applied in did:
                words = [action.name, *action.arguments]
                yield {"event": "action", "seat": seat, "action": words, "applied": applied}
        case RosterChanged(phase=phase, pause=pause):
            reason = {"reason": pause.reason} if pause is not None else {}
            yield {"event": "phase", "phase": phase, **reason}
        case ChatReceived(seat=seat):
            yield {"event": "said", "seat": seat}
        case Announced():
            yield {"event": "announced"}
        case GameEnded(outcome=outcome, reason=reason):
            # The outcome is any JSON object.
            yield {"event": "ended", "reason": str(outcome.get("reason", reason))}


MAX_WORDS = 500
"""Maximum length of a text of the server: of a description, which LSL sends to every program that
looks for streams, and of a marker's value."""


class Outlet(Protocol):
    """The used part of `pylsl.StreamOutlet`."""

    def push_sample(self, x: list[Any], timestamp: float) -> None:
        """Send a sample with its time by LSL's clock."""


class Outlets:
    """The step stream and the event stream of one game.

    Args:
        clock: LSL's clock in seconds.
    """

    def __init__(self, steps: Outlet, events: Outlet, clock: Callable[[], float]) -> None:
        self._steps = steps
        self._events = events
        self._clock = clock
        self._last_phase: tuple[str, str | None] | None = None

    def push(self, event: GameEvent, step: int, correction: float) -> None:
        """Send the samples of an event that has just arrived.

        Args:
            step: The current step of the game.
            correction: Seconds that the event's message took to arrive.
        """
        stamp = self._clock() - correction
        sample = step_sample(event, correction)
        if sample is not None:
            self._steps.push_sample(sample, stamp)
        if isinstance(event, RosterChanged):
            phase = event.phase, event.pause.reason if event.pause else None
            if phase == self._last_phase:
                return
            self._last_phase = phase
        for marker in markers(event, step):
            self._events.push_sample([marker], stamp)


def load_pylsl() -> ModuleType:
    """Import and return pylsl.

    Raises:
        MissingExtraError: It is not installed.
        RobotouilleError: Its native library is missing on this system.
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
    """Open the two outlets of an episode.

    Their source ids are `robotouille-EPISODE-steps` and `robotouille-EPISODE-events`.

    Args:
        offsets: Measured travel times of messages in seconds.
    """
    about = {"episode": episode, "task": task, "url": url}
    # The texts come from a server, and LSL puts them into XML, which has no control characters.
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
    # These names are those of XDF's metadata where it defines some.
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


FIRST_TRIPS = 5
KEPT_TRIPS = 12
TRIP_SECONDS = 5.0
"""Seconds between two measurements. The kept ones cover the last minute."""


class Latency:
    """Estimated travel time of messages: half of the shortest round trip of the last minute.

    The shortest one, because causes of longer ones (a busy machine, a full queue) say nothing
    about the next message.
    """

    def __init__(self) -> None:
        self.trips: deque[float] = deque(maxlen=KEPT_TRIPS)

    @property
    def seconds(self) -> float:
        """The travel time in seconds, or 0 before the first measurement."""
        return min(self.trips, default=0.0) / 2

    async def measure(self, client: Client) -> None:
        """Measure one more round trip, unless the connection is lost."""
        with suppress(ConnectionFailedError):
            self.trips.append(await client.round_trip())

    async def watch(self, client: Client) -> None:
        """Keep measuring."""
        while True:
            await asyncio.sleep(TRIP_SECONDS)
            await self.measure(client)


async def stream(
    client: Client, episode: str, opening: Callable[[Game, list[float]], Outlets]
) -> Game:
    """Watch and stream an episode to its end, and return the game.

    Args:
        opening: Makes the outlets from the game and the measured travel times.

    Raises:
        ConnectionFailedError: The connection is closed.
        ProtocolError: The server refuses.
    """
    latency = Latency()
    for _ in range(FIRST_TRIPS):
        await latency.measure(client)
    game = await client.join(episode, role="spectator")
    outlets = opening(game, [trip / 2 for trip in latency.trips] or [0.0])
    measuring = asyncio.create_task(latency.watch(client), name="round trips")
    try:
        async for event in game:
            outlets.push(event, game.step, latency.seconds)
    finally:
        measuring.cancel()
    return game


@dataclass(frozen=True, kw_only=True)
class LslOptions(ServerOptions):
    """Options of `robotouille-lsl`."""

    name: Annotated[str, typer.Option(callback=unicode, help="Name of the spectator.")] = "lsl"
    version: VersionOption = False


@interruptible
@failing
@options_from(LslOptions)
def command(
    episode: Annotated[
        str,
        typer.Argument(
            callback=unicode, help="Code of the episode; hosts may use its id.", show_default=False
        ),
    ],
    options: LslOptions,
) -> None:
    """Watch an episode, and stream its steps and actions to the Lab Streaming Layer."""
    pylsl = load_pylsl()
    where = options.address

    def opening(game: Game, offsets: list[float]) -> Outlets:
        tell(printable(f"streaming {game.episode}: {game.world.task.name}")[:MAX_WORDS], err=True)
        return open_outlets(pylsl, game.episode, game.world.task.name, where, offsets)

    async def run() -> Game:
        async with connect(where, name=options.name, token=options.token) as client:
            return await stream(client, episode, opening)

    game = asyncio.run(run())
    reason = str(game.outcome["reason"]) if game.outcome else "the connection was lost"
    tell(printable(f"ended at step {game.step}: {reason[:MAX_WORDS]}"), err=True)


def main() -> None:
    """Run `robotouille-lsl`."""
    application = typer.Typer(add_completion=False, rich_markup_mode="rich")
    application.command()(command)
    application()


if __name__ == "__main__":
    main()
