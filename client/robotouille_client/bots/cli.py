"""`robotouille-bot KIND`: a bot takes a seat and plays it."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError

from robotouille.errors import RobotouilleError
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_client.bots.player import MakePolicy, play
from robotouille_client.cli.console import TokenOption, explain, fail, server_url
from robotouille_client.connection import Client, connect

__all__ = ["main"]


async def _play(client: Client, episode: str | None, seat: str | None, make: MakePolicy) -> Any:
    if episode is None:
        waiting = [e for e in await client.episodes() if e.phase == "waiting"]
        if not waiting:
            raise RobotouilleError("no episode waits for players; name one with --episode CODE")
        episode = waiting[0].code
    game = await client.join(episode, seat=seat)
    typer.echo(f"{client.name} plays {game.seat} in {game.code}", err=True)
    return await play(game, make)


async def _run(
    url: str,
    name: str,
    token: str | None,
    episode: str | None,
    seat: str | None,
    make: MakePolicy,
) -> Any:
    async with connect(url, name=name, kind="bot", token=token) as client:
        return await _play(client, episode, seat, make)


def command(
    kind: Annotated[BotKind, typer.Argument(help="What decides: random, scripted or planner.")],
    episode: Annotated[
        str | None, typer.Option(help="Id or code; the first that waits if left out.")
    ] = None,
    host: Annotated[str, typer.Option(help="The server's host.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="The server's port.")] = 8765,
    url: Annotated[str | None, typer.Option(help="The server's URL, instead of both.")] = None,
    seat: Annotated[str | None, typer.Option(help="The seat to take, e.g. robot2.")] = None,
    name: Annotated[str | None, typer.Option(help="The bot's name.")] = None,
    token: TokenOption = None,
    plan: Annotated[Path | None, typer.Option(help="The plan that a scripted bot plays.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of what is random.")] = 0,
    json_output: Annotated[bool, typer.Option("--json", help="Print the outcome as JSON.")] = False,
) -> None:
    """Play a seat of an episode to its end."""
    try:
        make = policy_maker(kind, seed, plan)
        address = server_url(url, host, port)
        called = name or f"{kind.value}-bot"
        outcome = asyncio.run(_run(address, called, token, episode, seat, make))
    except (RobotouilleError, ValidationError) as error:
        fail(explain(error))
    except KeyboardInterrupt:
        raise typer.Exit(130) from None
    if json_output:
        typer.echo(json.dumps(outcome))
    elif outcome:
        typer.echo(f"{outcome['reason']} after {outcome['steps']} steps")
    else:
        fail("the connection was lost for good")


def main() -> None:
    """The entry point of `robotouille-bot`."""
    typer.run(command)
