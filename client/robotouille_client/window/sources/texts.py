"""Why a game stands still or is over for somebody, in words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from robotouille.episode import Reason
from robotouille.world.people.templates import capitalised
from robotouille_client.window.view import FarewellView

if TYPE_CHECKING:  # A game in this process has no messages, which take long to import.
    from robotouille.protocol.messages import SeatInfo

__all__ = [
    "clock_words",
    "comings_and_goings",
    "farewell",
    "joined_names",
    "outcome_words",
    "path_words",
    "pause_words",
    "rate_words",
    "readiness",
    "speaker",
    "waiting_words",
    "won",
]

REASONS = {
    "goal": "Goal reached",
    "step_limit": "Out of steps",
    "abandoned": "Given up",
    "aborted": "Stopped",
}

FAREWELLS = {
    "session/elsewhere": FarewellView(
        "This seat is now played from another window",
        "Only the newer window plays on.",
    ),
    "server/stopped": FarewellView("The server was stopped", "The game cannot go on here."),
    "rate/limited": FarewellView(
        "The server closed the connection", "It got far too many messages."
    ),
    "protocol/version": FarewellView(
        "The server is of another version",
        "It was replaced during the game. Update this program, then join again with the code.",
    ),
    "episode/unknown": FarewellView(
        "The server does not know this game any more",
        "It was started anew without it, or the game was over long ago. Open or join another one.",
    ),
    "episode/over": FarewellView(
        "The game is over", "It ended while the connection was lost. Open or join another one."
    ),
    "seat/taken": FarewellView(
        "Somebody else has your seat",
        "The connection was lost for too long. You can watch the game with its code.",
    ),
    "episode/full": FarewellView(
        "All seats are taken by now",
        "The connection was lost for too long. You can watch the game with its code.",
    ),
    **dict.fromkeys(
        ("auth/required", "auth/revoked", "auth/expired", "auth/invalid", "auth/role"),
        FarewellView(
            "The server does not let you in any more", "Ask whoever invited you for a new token."
        ),
    ),
}
UNREADABLE = FarewellView(
    "What the server sends cannot be read",
    "It may be of another version, or no server of Robotouille. Update this program, or ask whoever"
    " runs the server.",
)


def outcome_words(outcome: Mapping[str, object]) -> str:
    """`Goal reached in 31 steps`."""
    told = str(outcome.get("reason", "over"))
    reason, link = REASONS.get(told, told), "in" if told == "goal" else "after"
    detail = f": {outcome['detail']}" if outcome.get("detail") else ""
    return f"{reason} {link} {outcome.get('steps', 0)} steps{detail}"


def won(outcome: Mapping[str, object] | None) -> bool:
    """Whether a game has ended with its goal reached."""
    return outcome is not None and outcome.get("reason") == Reason.GOAL


def clock_words(clock: str, rules: Mapping[str, Any]) -> str:
    """`real time, 5 steps a second`."""
    if clock == "realtime" and "step_rate" in rules:
        return f"real time, {rate_words(rules['step_rate'])}"
    budget = rules.get("move_budget")
    return f"{clock}, {budget:g} s a move" if budget else clock


def rate_words(rate: float) -> str:
    """`5 steps a second`."""
    return f"{rate:g} step{'' if rate == 1 else 's'} a second"


def path_words(path: Path) -> str:
    """A path as its owner knows it: what is in their own folder begins with `~`."""
    try:
        return str(Path("~") / path.absolute().relative_to(Path.home()))
    except (ValueError, RuntimeError):
        return str(path)


def farewell(code: str, reason: str) -> FarewellView:
    """Why the owner of a window is out of a game that may go on without: by the code of the
    server's `bye`, else in the server's own words."""
    known = FAREWELLS.get(code)
    if known is not None:
        return known
    if code.startswith(("message/", "state/")):
        return UNREADABLE
    words = reason.strip() or "the connection was closed"
    ending = "" if words[-1] in ".!?" else "."
    return FarewellView("You are out of this game", f"{capitalised(words)}{ending}")


def pause_words(reason: str, seats: Iterable[SeatInfo], left: float | None) -> tuple[str, str]:
    """Why a game stands still, and what it waits for, with the seconds that are left."""
    away = [seat.name for seat in seats if seat.name and not seat.present]
    waiting = "Waiting" if left is None else f"Waiting {ceil(left)} s"
    match reason:
        case "absence":
            return _who_is_missing(away, list(seats)), f"{waiting}, then the game ends."
        case "restart":
            whom = joined_names(away) or "the others"
            return "The server was restarted", f"{waiting} for {whom}."
        case "operator":
            return "Paused by the operator", "The game goes on when the operator says so."
        case "player":
            return "Paused by the player", "The game goes on when the player does."
        case "storage":
            return (
                "The recording cannot be written",
                "Nothing is lost: the game goes on as soon as the server can write again.",
            )
        case "deserted":
            return "Everybody is away", f"{waiting}, then the game ends."
    return "The game stands still", f"{reason}. {waiting}."


def readiness(seat: SeatInfo) -> Literal["ready", "here", "away", "free"]:
    """How far a seat is before the beginning."""
    if not seat.name:
        return "free"
    if not seat.present:
        return "away"
    return "ready" if seat.ready else "here"


def waiting_words(seats: Iterable[SeatInfo], starts_in: float | None, me: str | None = None) -> str:
    """What a game that has not begun waits for."""
    if starts_in is not None:
        return f"Starts in {ceil(starts_in)}" if starts_in > 0 else "Starts now"
    seats = list(seats)
    if any(seat.player == me and not seat.ready for seat in seats):
        return "Waiting until you are ready"
    away = [seat.name for seat in seats if seat.name and not seat.present]
    free = sum(not seat.name for seat in seats)
    more = [f"{free} more player{'s' * (free != 1)}"] if free else []
    unready = [seat.name for seat in seats if readiness(seat) == "here"]
    if unready and not (away or more):
        return f"Waiting until {joined_names(unready)} {'is' if len(unready) == 1 else 'are'} ready"
    return f"Waiting for {joined_names([*away, *more]) or 'the others'}"


def comings_and_goings(
    before: Iterable[SeatInfo], now: Iterable[SeatInfo], me: str | None
) -> list[str]:
    """Who has come and gone between two rosters, but for oneself."""
    known = {seat.player: seat for seat in before}
    told = []
    for seat in now:
        old = known.get(seat.player)
        if old is None or seat.player == me:
            continue
        if old.name and old.name != seat.name:
            told.append(f"{old.name} has left")
        if seat.name and old.name != seat.name:
            told.append(f"{seat.name} joins")
        elif seat.name and old.present != seat.present:
            told.append(f"{seat.name} is back" if seat.present else f"{seat.name} is away")
        elif seat.name and seat.ready and not old.ready:
            told.append(f"{seat.name} is ready")
        elif seat.name and old.ready and not seat.ready:
            told.append(f"{seat.name} is not ready any more")
    return told


def speaker(name: str, seat: str) -> str:
    """Who has said something: `Bob`, or, of one without a seat, `Bob (watching)`."""
    return name if seat else f"{name} (watching)"


def _who_is_missing(away: list[str], seats: list[SeatInfo]) -> str:
    if len(away) == 1:
        return f"{away[0]}'s connection is lost"
    if away:
        return f"{joined_names(away)} have lost their connections"
    free = [seat.player for seat in seats if not seat.name]
    return f"Nobody plays {joined_names(free) or 'a seat'}"


def joined_names(names: list[str]) -> str:
    """`Ada, Ben and Cem`."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))
