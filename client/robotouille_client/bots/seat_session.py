"""A bot's stay in an episode: find it, join it, keep its seat, and play to the end."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, suppress
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

from robotouille.errors import ProtocolError, RobotouilleError, WrongWorldError
from robotouille.protocol.error_codes import ErrorCode
from robotouille.protocol.messages import Kind, View
from robotouille.terminal import printable, tell
from robotouille_client.bots.kinds import BotSetup, TrainedBot, bot_maker
from robotouille_client.bots.own_policy import OwnPolicyError
from robotouille_client.bots.seat_policy import MakePolicy, play, step_seconds
from robotouille_client.client import Client, connect
from robotouille_client.console.kept_seat import (
    KeptSeat,
    came_back,
    keep_seat,
    kept_seat_of,
    state_folder,
)
from robotouille_client.game import Game

Seats = Literal["all"] | tuple[str, ...]
Player = Callable[[Game], Awaitable[Mapping[str, Any]]]
"""Plays a game to its end and returns the outcome, or an empty mapping if it was cut off."""

REPORT_SECONDS = 0.5
"""Interval between checks for news to print."""


@runtime_checkable
class TextBot(Protocol):
    """A bot that plays a game joined in a view with text.

    `agent` describes it for recordings, in at most 200 characters. `partial` is true if it can play
    with a part of the state.
    """

    kind: Kind
    view: View
    agent: str
    partial: bool

    def opened(self) -> AbstractAsyncContextManager[Player]:
        """Return a context with the player.

        A seat is taken only inside the context, so that nobody waits for a model that cannot be
        reached.
        """
        ...


@dataclass(frozen=True, slots=True)
class SeatRequest:
    """The episode that a bot joins, its possible names and the seats it asks for.

    Attributes:
        names: Names in order of preference; the bot takes the first one that no other process on
            this machine plays under.
        episode: Id or code; the first episode that waits for players if None.
        seat: The single seat to take; any free one if None.
        seats: Several seats for one language model; replaces `seat`.
        stay: True to play the rematches, too, until nobody asks for one.
    """

    url: str
    names: Sequence[str]
    token: str | None = None
    episode: str | None = None
    seat: str | None = None
    seats: Seats = ()
    stay: bool = False


async def play_seat(
    request: SeatRequest, bot: BotSetup | MakePolicy | TextBot
) -> Mapping[str, Any]:
    """Join an episode, play it to its end and return the outcome; with `stay`, of the last game.

    Args:
        bot: A shipped bot, a function that makes the policy of a seat, or a language model.

    Raises:
        RobotouilleError: The seat cannot be taken, or the connection was lost for good.
    """
    if isinstance(bot, TextBot):
        async with bot.opened() as player:
            joining = _Joining(bot.view, bot.kind, bot.agent, bot.partial)
            return await _take_seat(request, player, joining)
    if isinstance(bot, BotSetup):
        setup = bot

        def play_shipped(game: Game) -> Awaitable[Mapping[str, Any]]:
            return play(game, bot_maker(setup, step_seconds=step_seconds(game.clock)))

        return await _take_seat(request, play_shipped, _Joining(agent=setup.agent))
    make_policy = bot
    check = bot.check if isinstance(bot, TrainedBot) else None
    return await _take_seat(request, lambda game: play(game, make_policy), _Joining(check=check))


@dataclass(frozen=True, slots=True)
class _Joining:
    """The view, the kind and the description with which a bot joins.

    `partial` is true if the bot can play with a part of the state. Shipped bots plan on all of it.
    `check` raises an error if the bot cannot play a task with a number of seats.
    """

    view: View = "state"
    kind: Kind = "bot"
    agent: str = ""
    partial: bool = False
    check: Callable[[str, int], None] | None = None

    @property
    def needs_whole(self) -> bool:
        """True if servers refuse the bot where players see a part of the kitchen."""
        return self.view != "text" and not self.partial


async def _take_seat(request: SeatRequest, player: Player, joining: _Joining) -> Mapping[str, Any]:
    kind = joining.kind
    code = request.episode or await _waiting_code(request, joining)
    with kept_seat_of(state_folder(), request.url, code, request.names) as (name, kept):
        asked = (request.seat,) if request.seat is not None else request.seats
        resume = kept.token_for(asked) if kept is not None else None
        async with connect(
            request.url, name=name, kind=kind, token=request.token, resume=resume
        ) as client:
            game = await _join(client, code, request, joining, kept)
            if back := came_back(client, game, kept):
                tell(printable(f"returned to {back}"), err=True)
            outcome = await _play(client, game, player, kept)
            if kept is not None:
                kept.forget()
            while outcome and request.stay and await _has_rematch(client, game):
                try:
                    game = await client.rematch(view=joining.view, agent=joining.agent)
                except ProtocolError as error:  # Others may have all seats, or have closed it.
                    tell(printable(f"the rematch is played without this bot: {error}"), err=True)
                    break
                outcome = await _play(client, game, player, None)
            if not outcome:
                raise RobotouilleError(game.farewell or "the connection was lost for good")
            return outcome


async def _has_rematch(client: Client, game: Game) -> bool:
    """Wait for a rematch of an ended game; return False once the server has closed its kitchen."""
    while client.protocol.membership is not None and not client.farewell:
        if game.rematch_code:
            return True
        await asyncio.sleep(REPORT_SECONDS)
    return False


async def _waiting_code(request: SeatRequest, joining: _Joining) -> str:
    name, kind = request.names[0], joining.kind
    async with connect(request.url, name=name, kind=kind, token=request.token) as client:
        waiting = await client.waiting_episode(partial=not joining.needs_whole)
        if waiting is not None:
            return waiting.code
        if joining.needs_whole and await client.waiting_episode(partial=True) is not None:
            raise RobotouilleError(
                "the players of all waiting episodes see a part of the kitchen, and this bot needs "
                "all of it; language models (llm) play them"
            )
    raise RobotouilleError("no episode waits for players; name one with --episode CODE")


async def _join(
    client: Client, code: str, request: SeatRequest, joining: _Joining, kept: KeptSeat | None
) -> Game:
    seats = request.seats
    if seats or joining.check is not None:
        await _check_episode(client, code, request, joining)
    try:
        game = await client.join(
            code,
            seat=request.seat,
            seats=seats,
            view=joining.view,
            agent=joining.agent,
            partial=joining.partial,
        )
    except ProtocolError as error:
        raise _with_advice(error, seats) from None
    if seats and game.clock.get("clock") == "realtime":
        await _leave(client, kept)
        raise _real_time_error(code)
    return game


async def _check_episode(
    client: Client, code: str, request: SeatRequest, joining: _Joining
) -> None:
    # Only hosts may list episodes. Others find out after joining.
    try:
        episodes = await client.episodes()
    except ProtocolError as error:
        if error.code != ErrorCode.AUTH_ROLE:
            raise
        return
    for episode in episodes:
        if code in (episode.code, episode.episode):
            if request.seats and episode.clock == "realtime":
                raise _real_time_error(code)
            if joining.check is not None:
                joining.check(episode.task, len(episode.seats))


def _real_time_error(code: str) -> RobotouilleError:
    return RobotouilleError(
        f"{code} is played in real time, where each seat needs a bot of its own. Leave out --seats "
        "and start one bot with --seat for each seat"
    )


def _with_advice(error: ProtocolError, seats: Seats) -> ProtocolError:
    if not seats or error.code not in (ErrorCode.SEAT_TAKEN, ErrorCode.SEAT_UNKNOWN):
        return error
    message = (
        f"{error.message}. The bot took none of the seats, and the other participants keep "
        "waiting: take the free seats with `--seats all`, or name them"
    )
    return ProtocolError(error.code, message, error.field)


async def _play(
    client: Client, game: Game, player: Player, kept: KeptSeat | None
) -> Mapping[str, Any]:
    own = ", ".join(game.own_seats)
    tell(printable(f"{game.name or client.name} plays {own} in {game.code}"), err=True)
    background = (keep_seat(client, game, kept), _report_connection(client), _report_free(game))
    tasks = [asyncio.create_task(each) for each in background]
    try:
        return await player(game)
    except (OwnPolicyError, WrongWorldError):
        await _leave(client, kept)
        raise
    finally:
        for task in tasks:
            task.cancel()


async def _leave(client: Client, kept: KeptSeat | None) -> None:
    # Leaving frees the seat at once; otherwise everybody would wait for the grace period.
    with suppress(RobotouilleError):
        await client.leave()
    if kept is not None:
        kept.forget()


async def _report_connection(client: Client) -> None:
    was_connected = True
    while True:
        is_connected = client.connected.is_set()
        if is_connected != was_connected:
            news = "connected again" if is_connected else "the server does not answer; reconnecting"
            tell(f"{client.name}: {news}", err=True)
        was_connected = is_connected
        await asyncio.sleep(REPORT_SECONDS)


async def _report_free(game: Game) -> None:
    reported: list[str] = []
    while game.phase == "waiting":
        free = [
            seat.player if not seat.name else f"{seat.name} to be ready"
            for seat in game.seats
            if not (seat.name and seat.ready)
        ]
        if free and free != reported:
            tell(printable(f"{game.seat} waits for {', '.join(free)}"), err=True)
            reported = free
        await asyncio.sleep(REPORT_SECONDS)
