"""Texts for tasks, outcomes, pauses and participants."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from robotouille.domain.loading import load_task, task_names
from robotouille.episode import Reason
from robotouille.errors import RobotouilleError
from robotouille.world.presentation.places import capitalised
from robotouille.world.presentation.signals import Intent
from robotouille.world.presentation.unserved import Unserved
from robotouille_client.window.view import FarewellView

if TYPE_CHECKING:
    from robotouille.protocol.messages import SeatInfo


FAMILIES = {
    "synchronous": "alone",
    "asynchronous": "alone, with waiting",
    "multi_agent": "together",
}
"""Families of tasks as players call them. Other families are called like their folders."""


def task_title(name: str) -> str:
    """Return `Together 01: lettuce burger` for `multi_agent/01_lettuce_burger`."""
    folder, file, variant = _parts(name)
    number, _, dish = file.partition("_")
    words = _goal(name) if _is_family(dish) else dish
    family = FAMILIES.get(folder, folder)
    title = f"{family} {number}: {words}".replace("_", " ").strip(" :").capitalize()
    return f"{title}, {variant}" if variant else title


def dish_title(name: str, goal: str) -> str:
    """Return the dish, such as `Lettuce burger`, or the goal of a file named after a family."""
    file = name.rpartition("/")[2]
    number, _, words = file.partition("_")
    dish = words if number.isdigit() and words else file
    return goal.rstrip(".") if _is_family(dish) else dish.replace("_", " ").capitalize()


def family_title(name: str) -> str:
    """Return `Together` for `multi_agent/01_lettuce_burger`."""
    folder = _parts(name)[0]
    return FAMILIES.get(folder, folder).replace("_", " ").capitalize()


def task_heading(name: str) -> str:
    """Return `together · 01` for `multi_agent/01_lettuce_burger`; empty without a folder."""
    folder, file, variant = _parts(name)
    family = FAMILIES.get(folder, folder).replace("_", " ")
    return " · ".join(filter(None, (family, file.partition("_")[0], variant))) if folder else ""


def _parts(name: str) -> tuple[str, str, str]:
    """Split `multi_agent/06_soup/free-42` into `multi_agent`, `06_soup` and `free-42`."""
    parts = name.split("/")
    numbered = (i for i, part in enumerate(parts) if part.partition("_")[0].isdigit())
    at = next(numbered, len(parts) - 1)
    return "/".join(parts[:at]), parts[at], "/".join(parts[at + 1 :])


def _is_family(dish: str) -> bool:
    # `training/01_synchronous` names its family instead of a dish.
    return any(name.startswith(f"{dish}/") for name in task_names())


# The list of tasks asks for every title whenever it is drawn, and loading a task is slow.
@lru_cache(maxsize=64)
def _goal(name: str) -> str:
    try:
        return load_task(name).goal_description.rstrip(".")
    except (RobotouilleError, OSError):
        return ""


REASONS = {
    "goal": "Goal reached",
    "shift_over": "Shift over",
    "step_limit": "Time is up",
    "abandoned": "Abandoned",
    "aborted": "Stopped",
}

FAREWELLS = {
    "session/elsewhere": FarewellView(
        "You are playing in another window",
        "Only the newer window can play this seat.",
    ),
    "server/stopped": FarewellView("The server has stopped", "This game can't continue."),
    "rate/limited": FarewellView(
        "The server closed the connection", "It received too many messages from this window."
    ),
    "protocol/version": FarewellView(
        "The server has a different version",
        "It was updated during the game. Update Robotouille, then join again with the code.",
    ),
    "episode/unknown": FarewellView(
        "The server no longer has this game",
        "It was restarted, or the game ended a while ago. Open or join another kitchen.",
    ),
    "episode/ended": FarewellView(
        "The game is over", "It ended while you were disconnected. Open or join another kitchen."
    ),
    "seat/taken": FarewellView(
        "Someone else took your seat",
        "You were disconnected for too long. You can still watch with the code.",
    ),
    "episode/full": FarewellView(
        "All seats are taken",
        "You were disconnected for too long. You can still watch with the code.",
    ),
    **dict.fromkeys(
        ("auth/required", "auth/revoked", "auth/expired", "auth/invalid", "auth/role"),
        FarewellView(
            "The server no longer accepts your token",
            "Ask the person who invited you for a new one.",
        ),
    ),
}
UNREADABLE = FarewellView(
    "Can't understand the server",
    "It may have a different version, or not be a Robotouille server. Update Robotouille or ask"
    " the server's operator.",
)


def outcome_words(outcome: Mapping[str, object]) -> str:
    """Return an outcome in words, such as `Goal reached in 31 steps`."""
    code = str(outcome.get("reason", "ended"))
    score = outcome.get("score")
    if code == Reason.SHIFT_OVER and isinstance(score, Mapping):
        return f"{REASONS[code]}: {score.get('points', 0)} points, {orders_words(outcome)}"
    reason, link = REASONS.get(code, code), "in" if code == "goal" else "after"
    detail = f": {outcome['detail']}" if outcome.get("detail") else ""
    return f"{reason} {link} {outcome.get('steps', 0)} steps{detail}"


def orders_words(outcome: Mapping[str, object]) -> str:
    """Return the orders of a shift in words, such as `5 orders served, 2 lost`."""
    score = outcome.get("score")
    score = score if isinstance(score, Mapping) else {}
    served, lost = score.get("served", 0), score.get("expired", 0)
    return f"{served} order{'s' * (served != 1)} served" + (f", {lost} lost" if lost else "")


def unserved_words(found: Unserved) -> str:
    """Return why a dish is not served, and what to do."""
    if not found.fault:
        return (
            f"Nobody has ordered this now: {found.dish}. Leave it for the next order, or take it"
            " apart to make room."
        )
    return (
        f"Not served, because it does not fit the order ({found.dish}): {found.fault}. Take it"
        " apart to change it."
    )


def points_of(outcome: Mapping[str, object] | None) -> int | None:
    """Return the points of a shift that is over; None for other games."""
    score = None if outcome is None else outcome.get("score")
    if outcome is None or outcome.get("reason") != Reason.SHIFT_OVER:
        return None
    return int(score.get("points", 0)) if isinstance(score, Mapping) else None


def won(outcome: Mapping[str, object] | None) -> bool:
    """Return whether the game ended with its goal reached, or as a shift with points."""
    points = points_of(outcome)
    if outcome is None or points is not None:
        return (points or 0) > 0
    return outcome.get("reason") == Reason.GOAL


def clock_words(clock: str, rules: Mapping[str, Any], players: int) -> str:
    """Return a clock in words, such as `real time, 5 steps a second`."""
    if clock == "realtime" and "step_rate" in rules:
        return f"real time, {rate_words(rules['step_rate'])}"
    words = {"turn": "taking turns", "lockstep": "all move at once", "realtime": "real time"}
    pace = words.get(clock, clock) if players > 1 or clock == "realtime" else "no hurry"
    budget = rules.get("move_budget")
    return f"{pace}, {budget:g} s a move" if budget else pace


def time_words(seconds: float) -> str:
    """Return a time in words, such as `2 minutes 30 seconds`."""
    minutes, rest = divmod(round(seconds), 60)
    parts = [(minutes, "minute"), (rest, "second")]
    words = [f"{number} {unit}{'s' * (number != 1)}" for number, unit in parts if number]
    return " ".join(words) or "0 seconds"


def rate_words(rate: float) -> str:
    """Return a step rate in words, such as `5 steps a second`."""
    return f"{rate:g} step{'' if rate == 1 else 's'} a second"


def path_words(path: Path) -> str:
    """Return a path, with `~` for the home folder."""
    try:
        return str(Path("~") / path.absolute().relative_to(Path.home()))
    except (ValueError, RuntimeError):
        return str(path)


def farewell(code: str, reason: str) -> FarewellView:
    """Return why the player was removed from a game that may go on.

    The text depends on the code of the server's `bye` message. For unknown codes it is the
    server's own reason.
    """
    # A text of our own says what the player can do next; the server's reason does not.
    known = FAREWELLS.get(code)
    if known is not None:
        return known
    # The client itself ends the game with these codes if it cannot read a message.
    if code.startswith(("message/", "state/")):
        return UNREADABLE
    words = reason.strip() or "the connection was closed"
    ending = "" if words[-1] in ".!?" else "."
    return FarewellView("You're out of the game", f"{capitalised(words)}{ending}")


def pause_words(reason: str, seats: Iterable[SeatInfo], left: float | None) -> tuple[str, str]:
    """Return the reason for a pause and what ends it, with the seconds that are left."""
    away = [seat.name for seat in seats if seat.name and not seat.present]
    waiting = "Waiting" if left is None else f"Waiting {ceil(left)} s"
    ending = "The game ends soon" if left is None else f"The game ends in {ceil(left)} s"
    match reason:
        case "absence":
            verb = "comes" if len(away) == 1 else "come"
            unless = f"{joined_names(away)} {verb} back" if away else "someone takes the seat"
            return _who_is_missing(away, list(seats)), f"{ending} unless {unless}."
        case "restart":
            whom = joined_names(away) or "the others"
            return "The server restarted", f"{waiting} for {whom}."
        case "operator":
            return "Paused by the operator", "The operator will resume the game."
        case "player":
            return "Paused by the player", "The player will resume the game."
        case "storage":
            return (
                "The recording can't be saved",
                "Nothing is lost. The game resumes as soon as the server can save again.",
            )
        case "deserted":
            return "Everyone is away", f"{ending}."
    return "Paused", f"{capitalised(reason)}. {waiting}."


def readiness(seat: SeatInfo) -> Literal["ready", "here", "away", "free"]:
    """Return the state of a seat before the start."""
    if not seat.name:
        return "free"
    if not seat.present:
        return "away"
    return "ready" if seat.ready else "here"


def waiting_words(seats: Iterable[SeatInfo], starts_in: float | None, me: str | None = None) -> str:
    """Return what a game that has not started is waiting for."""
    if starts_in is not None:
        return f"Starting in {ceil(starts_in)}" if starts_in > 0 else "Go!"
    seats = list(seats)
    if any(seat.player == me and not seat.ready for seat in seats):
        return "Waiting for you to get ready"
    away = [seat.name for seat in seats if seat.name and not seat.present]
    free = sum(not seat.name for seat in seats)
    more = [f"{free} more player{'s' * (free != 1)}"] if free else []
    unready = [seat.name for seat in seats if readiness(seat) == "here"]
    if unready and not (away or more):
        return f"Waiting for {joined_names(unready)} to get ready"
    return f"Waiting for {joined_names([*away, *more]) or 'the others'}"


def comings_and_goings(
    before: Iterable[SeatInfo], now: Iterable[SeatInfo], me: str | None
) -> list[str]:
    """Return a line for each change between two rosters, without the player's own seat."""
    known = {seat.player: seat for seat in before}
    lines = []
    for seat in now:
        old = known.get(seat.player)
        if old is None or seat.player == me:
            continue
        if old.name and old.name != seat.name:
            lines.append(f"{old.name} left")
        if seat.name and old.name != seat.name:
            lines.append(f"{seat.name} joined")
        elif seat.name and old.present != seat.present:
            lines.append(f"{seat.name} is back" if seat.present else f"{seat.name} is away")
        elif seat.name and seat.ready and not old.ready:
            lines.append(f"{seat.name} is ready")
        elif seat.name and old.ready and not seat.ready:
            lines.append(f"{seat.name} is no longer ready")
    return lines


def speaker(name: str, seat: str) -> str:
    """Return the name of a speaker, such as `Bob`, or `Bob (watching)` without a seat."""
    return name if seat else f"{name} (watching)"


def _who_is_missing(away: list[str], seats: list[SeatInfo]) -> str:
    if len(away) == 1:
        return f"{away[0]} lost the connection"
    if away:
        return f"{joined_names(away)} lost the connection"
    free = [seat.player for seat in seats if not seat.name]
    return f"Nobody is playing {joined_names(free) or 'a seat'}"


def joined_names(names: list[str]) -> str:
    """Return names as a list, such as `Ada, Ben and Cem`."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def signal_words(intent: Intent) -> str:
    """Return the words of a signal in a bubble, where a picture shows what it points at."""
    return _SIGNALS[intent]


_SIGNALS = {
    Intent.NEED: "I need",
    Intent.YOURS: "You take",
    Intent.LOOK: "Look!",
    Intent.WAIT: "Wait!",
    Intent.THANKS: "Thank you!",
}
