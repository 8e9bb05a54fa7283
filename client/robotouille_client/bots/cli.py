"""`robotouille-bot KIND`: a bot takes a seat and plays it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol, runtime_checkable

import typer

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.program import VersionOption, printable, tell
from robotouille_client.bots import llm_options as llm
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_client.bots.names import given_names
from robotouille_client.console import (
    SERVER_HOST,
    SERVER_PORT,
    HostOption,
    PortOption,
    TokenOption,
    UrlOption,
    failing,
    interruptible,
    server_url,
    unicode,
)

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping
    from contextlib import AbstractAsyncContextManager

    from robotouille.protocol.messages import Kind, View
    from robotouille_client.bots.seat_policy import MakePolicy
    from robotouille_client.client import Client
    from robotouille_client.console.kept_seat import KeptSeat
    from robotouille_client.game import Game

    Seats = Literal["all"] | tuple[str, ...]
    Player = Callable[[Game], Awaitable[Mapping[str, Any]]]
    """Plays to the end; the outcome, empty if the connection was lost for good."""

__all__ = ["main"]


LOOK_SECONDS = 0.5
LLM = "llm"
"""A language model, by the text view."""


@runtime_checkable
class TextBot(Protocol):
    """Plays a game that is joined in a view with text; `kind` is what others see it as."""

    kind: Kind
    view: View

    def opened(self) -> AbstractAsyncContextManager[Player]:
        """What plays it to its end; a seat is taken only when there is somebody to play it."""
        ...


@dataclass(frozen=True, slots=True)
class SeatChoice:
    """Which episode of a server a bot enters, as whom, and for which seats.

    Without an `episode` it is the first that waits for players. Of several `names` it is the first
    that no other process here plays under. `seats` are several that one model plays; else it is
    `seat`, or any that is free.
    """

    url: str
    names: Sequence[str]
    token: str | None = None
    episode: str | None = None
    seat: str | None = None
    seats: Seats = ()


async def _waiting(entry: SeatChoice, kind: Kind) -> str:
    """The code of the first episode that waits for players."""
    from robotouille_client.client import connect

    async with connect(entry.url, name=entry.names[0], kind=kind, token=entry.token) as client:
        waiting = await client.waiting_episode()
    if waiting is None:
        raise RobotouilleError("no episode waits for players; name one with --episode CODE")
    return waiting.code


async def _run(entry: SeatChoice, bot: MakePolicy | TextBot) -> Any:
    """Make the bot ready, and then play to the end."""
    from robotouille_client.bots.player import play

    if isinstance(bot, TextBot):
        async with bot.opened() as player:
            return await _take_seat(entry, player, bot.view, bot.kind)
    make_policy = bot
    return await _take_seat(entry, lambda game: play(game, make_policy), "state", "bot")


async def _take_seat(entry: SeatChoice, player: Player, view: View, kind: Kind) -> Any:
    """Play to the end; in the seat that a process of this name had that was killed, if it had."""
    from robotouille_client.client import connect
    from robotouille_client.console.kept_seat import came_back, kept_seat_of, state_folder

    code = entry.episode or await _waiting(entry, kind)
    with kept_seat_of(state_folder(), entry.url, code, entry.names) as (name, kept):
        asked = (entry.seat,) if entry.seat is not None else entry.seats
        resume = kept.token_for(asked) if kept is not None else None
        async with connect(
            entry.url, name=name, kind=kind, token=entry.token, resume=resume
        ) as client:
            game = await _join(client, code, entry, view, kept)
            if back := came_back(client, game, kept):
                tell(printable(f"came back into {back}"), err=True)
            own = ", ".join(game.own_seats)
            tell(printable(f"{game.name or name} plays {own} in {game.code}"), err=True)
            outcome = await _play(client, game, player, kept)
            if kept is not None:
                kept.forget()
            if not outcome:
                raise RobotouilleError(game.farewell or "the connection was lost for good")
            return outcome


async def _join(
    client: Client, code: str, entry: SeatChoice, view: View, kept: KeptSeat | None
) -> Game:
    """Join an episode, whose world waits for one who plays several seats."""
    seats = entry.seats
    if seats:
        await _require_waiting_world(client, code)
    try:
        game = await client.join(code, seat=entry.seat, seats=seats, view=view)
    except ProtocolError as error:
        raise _what_to_do(error, seats) from None
    if seats and game.clock.get("clock") == "realtime":
        await _give_up(client, kept)
        raise _real_time(code)
    return game


async def _play(
    client: Client, game: Game, player: Player, kept: KeptSeat | None
) -> Mapping[str, Any]:
    """Play to the end, while the seat is written down, and what goes on is told."""
    import asyncio

    from robotouille_client.bots.own_policy import OwnPolicyError
    from robotouille_client.console.kept_seat import keep_seat

    meanwhile = (keep_seat(client, game, kept), _tell_of_line(client), _tell_of_free_seats(game))
    tasks = [asyncio.create_task(each) for each in meanwhile]
    try:
        return await player(game)
    except OwnPolicyError:
        await _give_up(client, kept)
        raise
    finally:
        for task in tasks:
            task.cancel()


async def _require_waiting_world(client: Client, code: str) -> None:
    """Raises RobotouilleError where the world would not wait for one who plays several seats.

    Only a host may look before it joins; anybody else sees it then.
    """
    from robotouille.protocol.error_codes import ErrorCode

    try:
        episodes = await client.episodes()
    except ProtocolError as error:
        if error.code != ErrorCode.AUTH_ROLE:
            raise
        return
    if any(e.clock == "realtime" for e in episodes if code in (e.code, e.episode)):
        raise _real_time(code)


def _real_time(code: str) -> RobotouilleError:
    return RobotouilleError(
        f"{code} is played in real time, where each seat takes a model of its own: no --seats. "
        "Start a bot for each seat, with --seat; the others wait for them"
    )


def _what_to_do(error: ProtocolError, seats: Seats) -> ProtocolError:
    """Seats are taken together or not at all: the others in the game wait for those left free."""
    from robotouille.protocol.error_codes import ErrorCode

    if not seats or error.code not in (ErrorCode.SEAT_TAKEN, ErrorCode.SEAT_UNKNOWN):
        return error
    told = (
        f"{error.message}; none of the seats was taken, and the others in the game wait: take "
        "those that are free with `--seats all`, or some by name"
    )
    return ProtocolError(error.code, told, error.field)


def _seats(kind: str, seat: str | None, seats: str | None, control: str | None) -> Seats:
    """The seats that are named, several or all of them."""
    if seats is None:
        if control is not None:
            raise RobotouilleError("--control is for one model in several --seats")
        return ()
    if kind != LLM:
        raise RobotouilleError(
            "only a language model (llm) plays several --seats; "
            "start a bot for each seat, with --seat"
        )
    if seat is not None:
        raise RobotouilleError("--seat is for one seat, --seats for several: not both")
    return "all" if seats == "all" else tuple(each.strip() for each in seats.split(","))


async def _give_up(client: Client, kept: KeptSeat | None) -> None:
    """Free the seat: nobody is to wait for a bot whose policy does not work."""
    with suppress(RobotouilleError):
        await client.leave()
    if kept is not None:
        kept.forget()


async def _tell_of_line(client: Client) -> None:
    """Say when the server is gone, and when it is back."""
    import asyncio

    was_there = True
    while True:
        is_there = client.connected.is_set()
        if is_there != was_there:
            news = "back on the line" if is_there else "the server does not answer; trying again"
            tell(f"{client.name}: {news}", err=True)
        was_there = is_there
        await asyncio.sleep(LOOK_SECONDS)


async def _tell_of_free_seats(game: Game) -> None:
    """Say for which seats the game waits, when it does and whenever these change."""
    import asyncio

    told: list[str] = []
    while game.phase == "waiting":
        free = [seat.player for seat in game.seats if not seat.name]
        if free and free != told:
            tell(printable(f"{game.seat} waits for {', '.join(free)}"), err=True)
            told = free
        await asyncio.sleep(LOOK_SECONDS)


def _maker(kind: str, seed: int, plan: Path | None) -> MakePolicy:
    """How to make the policy of a bot that is shipped, or of the user's own."""
    if ":" in kind:
        from robotouille_client.bots.own_policy import own_policy_maker

        return own_policy_maker(kind)
    if kind not in list(BotKind):
        shipped = ", ".join([*BotKind, LLM])
        raise RobotouilleError(f"there is no bot {kind!r}; possible: {shipped}, or MODULE:NAME")
    return policy_maker(BotKind(kind), seed, plan)


def _language_model(model: str, **options: Any) -> TextBot:
    """From the package for evaluation, which is loaded only if it is asked for."""
    from importlib import import_module

    bots = import_module("robotouille_evaluation.cli.bot")
    made: TextBot = bots.LanguageModelBot.of(model, **options)
    return made


@contextmanager
def _frames_told() -> Iterator[None]:
    """Where somebody's own policy fails, the lines of it come before the error."""
    from robotouille_client.bots.own_policy import OwnPolicyError

    try:
        yield
    except OwnPolicyError as error:
        if error.frames:
            tell(error.frames, err=True)
        raise


@interruptible
@failing
def command(
    kind: Annotated[
        str,
        typer.Argument(
            help="What decides: random, scripted, planner, llm (a language model), or "
            "MODULE:NAME of your own."
        ),
    ],
    episode: Annotated[
        str | None,
        typer.Option(callback=unicode, help="Id or code; the first that waits if left out."),
    ] = None,
    host: HostOption = SERVER_HOST,
    port: PortOption = SERVER_PORT,
    url: UrlOption = None,
    seat: Annotated[str | None, typer.Option(help="The seat to take, e.g. robot2.")] = None,
    seats: llm.Seats = None,
    control: llm.Control = None,
    name: Annotated[
        str | None,
        typer.Option(
            callback=unicode, help="The bot's name; else a given name, or that of its class."
        ),
    ] = None,
    token: TokenOption = None,
    plan: Annotated[Path | None, typer.Option(help="The plan that a scripted bot plays.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of what is random.")] = 0,
    model: llm.Model = "mock",
    base_url: llm.BaseUrl = "",
    strategy: llm.Strategy = "react-last-reasoning-action",
    temperature: llm.Temperature = None,
    price: llm.Price = "",
    timeout: llm.Timeout = None,
    attempts: llm.Attempts = None,
    transcript: llm.Transcript = None,
    late: llm.Late = "apply",
    helper: llm.Helper = "none",
    digest_tokens: llm.DigestTokens = 0,
    charge: llm.Charge = "wall",
    json_output: Annotated[bool, typer.Option("--json", help="Print the outcome as JSON.")] = False,
    version: VersionOption = False,
) -> None:
    """Play a seat of an episode to its end."""
    import asyncio

    several = _seats(kind, seat, seats, control)
    with _frames_told():
        if kind == LLM:
            bot: MakePolicy | TextBot = _language_model(
                model, base_url=base_url, strategy=strategy, transcript=transcript, seed=seed,
                temperature=temperature, prices=price, timeout=timeout, attempts=attempts,
                late=late, helper=helper, digest_tokens=digest_tokens, charge=charge,
                control=(control or "turns") if several else "each",
            )  # fmt: skip
        else:
            bot = _maker(kind, seed, plan)
        own = [f"{kind.rpartition(':')[2]}-bot"] if ":" in kind else given_names(seed, seat)
        names = [name] if name else own
        entry = SeatChoice(server_url(url, host, port), names, token, episode, seat, several)
        outcome = asyncio.run(_run(entry, bot))
    if json_output:
        typer.echo(json.dumps(outcome))
    else:
        tell(printable(f"{outcome['reason']} after {outcome['steps']} steps"))


def main() -> None:
    """The entry point of `robotouille-bot`.

    Bots plan in plain Python: compiling takes half a minute, in which others would wait.
    """
    os.environ.setdefault("ROBOTOUILLE_COMPILE", "0")
    typer.run(command)


if __name__ == "__main__":
    main()
