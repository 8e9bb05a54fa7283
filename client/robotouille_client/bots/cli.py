"""`robotouille-bot KIND`: a bot takes a seat and plays it."""

from __future__ import annotations

import asyncio
import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille.world.state import State
from robotouille_client.bots.player import MakePolicy, play
from robotouille_client.bots.policies import Policy, RandomPolicy, ScriptedPolicy
from robotouille_client.cli.console import fail, server_url
from robotouille_client.connection import Client, connect

__all__ = ["BotKind", "main", "policy_maker"]


class BotKind(StrEnum):
    """What decides: chance, a plan file, or search."""

    RANDOM = "random"
    SCRIPTED = "scripted"
    PLANNER = "planner"


def policy_maker(kind: BotKind, seed: int = 0, plan: Path | None = None) -> MakePolicy:
    """How to make the policy of a seat."""

    def make(state: State, player: str) -> Policy:
        if kind is BotKind.RANDOM:
            return RandomPolicy(player, seed)
        if kind is BotKind.SCRIPTED:
            return _scripted(state, player, plan)
        from robotouille.planning.policy import PlannerPolicy

        return PlannerPolicy(state.world, player, seed=seed)

    return make


def _scripted(state: State, player: str, plan: Path | None) -> Policy:
    from robotouille.planning.plan import read_plan

    from robotouille.world.world import World

    if plan is None:
        raise RobotouilleError("a scripted bot plays a plan file: --plan FILE")
    task = state.world.task
    rehearsal = World(type(task).from_json({**task.to_json(), "timing": "benchmark"}))
    try:
        text = plan.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(str(plan), [Fault("", f"cannot be read: {error}")]) from None
    return ScriptedPolicy(rehearsal, player, read_plan(text, rehearsal))


async def _play(client: Client, episode: str | None, seat: str | None, make: MakePolicy) -> Any:
    if episode is None:
        waiting = [e for e in await client.episodes() if e.phase == "waiting"]
        if not waiting:
            raise RobotouilleError("no episode waits for players; name one with --episode CODE")
        episode = waiting[0].code
    game = await client.join(episode, seat=seat)
    typer.echo(f"{client.name} plays {game.seat} in {game.code}", err=True)
    return await play(game, make)


async def _run(url: str, name: str, episode: str | None, seat: str | None, make: MakePolicy) -> Any:
    async with connect(url, name=name, kind="bot") as client:
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
    plan: Annotated[Path | None, typer.Option(help="The plan that a scripted bot plays.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of what is random.")] = 0,
    json_output: Annotated[bool, typer.Option("--json", help="Print the outcome as JSON.")] = False,
) -> None:
    """Play a seat of an episode to its end."""
    try:
        make = policy_maker(kind, seed, plan)
        address = server_url(url, host, port)
        outcome = asyncio.run(_run(address, name or f"{kind.value}-bot", episode, seat, make))
    except RobotouilleError as error:
        fail(str(error))
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
