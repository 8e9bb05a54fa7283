"""Command `robotouille-bot KIND`: a bot takes a seat and plays it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from robotouille.errors import RobotouilleError
from robotouille.terminal import options_from, printable, tell
from robotouille_client.bots.bot_names import bot_named, is_own
from robotouille_client.bots.kinds import (
    BotKind,
    BotSetup,
    TrainedBot,
    bot_maker,
    given_names,
)
from robotouille_client.bots.llm_options import LlmBotOptions
from robotouille_client.console import (
    ServerOptions,
    VersionOption,
    failing,
    interruptible,
    unicode,
)

if TYPE_CHECKING:
    from robotouille_client.bots.seat_policy import MakePolicy
    from robotouille_client.bots.seat_session import Seats, TextBot

    _Bot: TypeAlias = BotSetup | MakePolicy | TextBot

LLM = "llm"


@dataclass(frozen=True, kw_only=True)
class BotOptions(LlmBotOptions, ServerOptions):
    """Options of `robotouille-bot`."""

    episode: Annotated[
        str | None,
        typer.Option(
            callback=unicode,
            help="Code of the episode; hosts may use its id. Default: the first one that waits "
            "for players.",
        ),
    ] = None
    seat: Annotated[str | None, typer.Option(help="Seat to take, such as robot2.")] = None
    name: Annotated[
        str | None,
        typer.Option(
            callback=unicode, help="Name of the bot. Default: a given name, or that of its class."
        ),
    ] = None
    plan: Annotated[Path | None, typer.Option(help="Plan file for a scripted bot.")] = None
    skill: Annotated[
        str,
        typer.Option(
            help="Skill of a planner: learner, partner or expert. Default: partner in real-time "
            "games with people, else expert."
        ),
    ] = ""
    stay: Annotated[
        bool, typer.Option("--stay", help="Play rematches, too. Wait two minutes for each.")
    ] = False
    seed: Annotated[int, typer.Option(help="Seed of random decisions.")] = 0
    json_output: Annotated[bool, typer.Option("--json", help="Print the outcome as JSON.")] = False
    version: VersionOption = False


def _requested_seats(kind: str, options: BotOptions) -> Seats:
    seats = options.seats
    if seats is None:
        if options.control is not None:
            raise RobotouilleError(
                "--control needs --seats, for one language model in several seats"
            )
        return ()
    if kind != LLM:
        raise RobotouilleError(
            "only a language model (llm) plays several --seats; "
            "start one bot with --seat for each seat"
        )
    if options.seat is not None:
        raise RobotouilleError("use either --seat for one seat or --seats for several, not both")
    return "all" if seats == "all" else tuple(each.strip() for each in seats.split(","))


def _bot(kind: str, options: BotOptions) -> _Bot:
    if options.skill and kind != BotKind.PLANNER:
        raise RobotouilleError("only a planner has a --skill")

    def own(name: str) -> MakePolicy:
        from robotouille_client.bots.own_policy import own_policy_maker

        return own_policy_maker(name)

    def shipped(kind: BotKind) -> BotSetup:
        setup = BotSetup(kind, options.seed, options.skill, options.plan)
        bot_maker(setup)  # Report a wrong option before a seat is taken.
        return setup

    makers: dict[str, Callable[[], _Bot]] = {each: partial(shipped, each) for each in BotKind}
    makers[LLM] = partial(_language_model, options)
    return bot_named(kind, makers, trained=partial(TrainedBot, seed=options.seed), own=own)


def _language_model(options: BotOptions) -> TextBot:
    # The client must work without the evaluation package, so that is imported by name here.
    from importlib import import_module

    bots = import_module("robotouille_evaluation.cli.bot")
    control = (options.control or "turns") if options.seats is not None else "each"
    bot: TextBot = bots.LanguageModelBot.of(options, seed=options.seed, control=control)
    return bot


@interruptible
@failing
@options_from(BotOptions)
def command(
    kind: Annotated[
        str,
        typer.Argument(
            help="The bot: random, scripted, planner, llm (a language model), MODULE:NAME of "
            "your own, or FILE.npz of robotouille-train."
        ),
    ],
    options: BotOptions,
) -> None:
    """Play a seat of an episode to its end."""
    import asyncio

    from robotouille_client.bots.seat_session import SeatRequest, play_seat

    seats = _requested_seats(kind, options)
    bot = _bot(kind, options)
    own_name = [f"{Path(kind).stem.rpartition(':')[2]}-bot"]
    default = own_name if is_own(kind) else given_names(options.seed, options.seat)
    request = SeatRequest(
        options.address,
        [options.name] if options.name else default,
        options.token,
        options.episode,
        options.seat,
        seats,
        options.stay,
    )
    outcome: Any = asyncio.run(play_seat(request, bot))
    if options.json_output:
        typer.echo(json.dumps(outcome))
    else:
        tell(printable(f"{outcome['reason']} after {outcome['steps']} steps"))


def main() -> None:
    """Run `robotouille-bot`."""
    # Compiling the planner takes half a minute, during which the other participants would wait.
    os.environ.setdefault("ROBOTOUILLE_COMPILE", "0")
    typer.run(command)


if __name__ == "__main__":
    main()
