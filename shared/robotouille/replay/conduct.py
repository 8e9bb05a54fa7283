"""Checks that a recording obeys the rules of play that re-simulating its actions cannot show.

Every check holds for all recordings of honest games: also for games that a server continued after
a crash, and for games that an operator ended. docs/recordings.md lists the checks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Protocol

from pydantic import ValidationError

from robotouille.episode.events import Reason
from robotouille.episode.rules import Clock, Rules
from robotouille.errors import RecordingError
from robotouille.replay.frame_schema import FrameSource, milliseconds
from robotouille.replay.measures import measures
from robotouille.world.world import State

EARLY_MS = 50
"""Milliseconds by which times may go back. A timer may fire early by the resolution of the event
loop's clock, which is 16 ms on some systems."""


class PlayedGame(FrameSource, Protocol):
    """Source of frames with a header."""

    header: dict[str, Any]


def rules_in(header: Mapping[str, Any]) -> Rules:
    """Return the rules in a header.

    Raises:
        RecordingError: The rules are invalid.
    """
    try:
        return Rules.model_validate(header["rules"], strict=False)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(map(str, first["loc"]))
        raise RecordingError(f"rules.{field}: {first['msg']}") from None


class Conduct:
    """Check of the steps of a recording, one after the other, against its rules.

    Args:
        header: The recording's header.
        players: The players in seat order.

    Raises:
        RecordingError: The rules are invalid.
    """

    def __init__(self, header: Mapping[str, Any], players: tuple[str, ...]) -> None:
        self._rules = rules_in(header)
        # Only runs without a server draw random reversals. They have no join code.
        self._served = bool(header.get("code"))
        self._players = players
        self.latest = 0

    def wrong_note(self, frame: Mapping[str, Any]) -> str:
        """Return what is wrong with a frame of notes; empty if nothing is."""
        for note in frame["notes"]:
            # A spectator's chat has an empty player.
            if (player := note.get("player")) and player not in self._players:
                return f"a note is about {player!r}, which is not a player of the task"
        return ""

    def fault(self, frame: Mapping[str, Any], before: State) -> str:
        """Return what is wrong with the next step; empty if nothing is.

        Args:
            before: The state before the step.
        """
        return next(self._faults(frame, before), "")

    def _faults(self, frame: Mapping[str, Any], before: State) -> Iterator[str]:
        step, most = frame["step"], self._rules.max_steps
        if before.goal_reached:
            yield "the goal was reached in an earlier step"
        if before.shift_over:
            yield "the shift was over in an earlier step"
        if step > most:
            yield f"the rules allow {most} steps"
        yield from self._seat_faults(frame)
        for move in frame["moves"]:
            if move.get("basis", -1) >= step:
                yield f"the action of {move['player']} has the basis {move['basis']}, a later state"
        if self._served and frame.get("undone"):
            yield "facts are undone by chance, but episodes of a server have no chance"
        if frame["t"] < self.latest - EARLY_MS:
            yield f"its time {frame['t']} ms is before the previous step's {self.latest} ms"
        self.latest = max(self.latest, frame["t"])

    def _seat_faults(self, frame: Mapping[str, Any]) -> Iterator[str]:
        movers = [move["player"] for move in frame["moves"]]
        movers += [player for player, _ in frame.get("idle", ())]
        turn = None
        if self._rules.clock == Clock.TURN:
            turn = self._players[(frame["step"] - 1) % len(self._players)]
        seen: set[str] = set()
        for player in movers:
            if player in seen:
                yield f"{player} acts twice"
            if turn is not None and player != turn:
                yield f"{player} acts, but it is {turn}'s turn"
            seen.add(player)


def wrong_outcome(recording: PlayedGame, outcome: Mapping[str, Any], latest: int) -> str:
    """Return what is wrong with an outcome; empty if nothing is.

    Args:
        latest: Time of the last step, in milliseconds.
    """
    reason, steps = outcome["reason"], outcome["steps"]
    most = recording.header["rules"]["max_steps"]
    if reason not in list(Reason):
        return f"the outcome has the unknown reason {reason!r}"
    if reason == Reason.STEP_LIMIT and steps != most:
        return f"the outcome is 'step_limit' after {steps} steps, but the rules allow {most}"
    if milliseconds(outcome["seconds"]) < latest - EARLY_MS:
        return f"the outcome has {outcome['seconds']} seconds, but the last step is at {latest} ms"
    return _wrong_tallies(recording, outcome["seats"])


def _wrong_tallies(recording: PlayedGame, tallies: list[Mapping[str, Any]]) -> str:
    found = measures(recording).seats
    if [tally["player"] for tally in tallies] != list(found):
        return "the outcome does not list the seats of the task"
    # Rejections beyond a seat's quota are counted, but not recorded.
    full = {note["player"] for note in recording.notes() if note["note"] == "quota"}
    for tally in tallies:
        player = tally["player"]
        seat = found[player]
        rejected = sum(seat.all_rejected.values())
        counts = {"rejected": rejected, "invalid": seat.invalid, "malformed": seat.malformed}
        exact = {**seat.activities, "said": seat.said}
        for name, number in {**exact, **counts}.items():
            more_allowed = name in counts and player in full
            if tally[name] < number or (tally[name] > number and not more_allowed):
                told = tally[name]
                return f"the outcome has {name} {told} for {player}, but the frames give {number}"
    return ""
