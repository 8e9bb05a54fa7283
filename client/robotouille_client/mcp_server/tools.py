"""The tools: what a client of the Model Context Protocol can do on a game server."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal, TypeAlias

from mcp.server.mcpserver import Context
from mcp.server.mcpserver.exceptions import ToolError
from mcp.types import CallToolResult, TextContent
from pydantic import BaseModel, Field

from robotouille.world.sentences import MAX_SENTENCE
from robotouille_client.mcp_server.advice import explained
from robotouille_client.mcp_server.callers import caller_of
from robotouille_client.mcp_server.open_game import Until
from robotouille_client.mcp_server.open_games import OpenGames
from robotouille_client.mcp_server.results import (
    Created,
    EpisodeList,
    EpisodeRow,
    GameView,
    Left,
    SeatRow,
    Spoken,
    ValidActions,
)
from robotouille_client.mcp_server.wording import chat_words, episode_words, view_words

__all__ = ["TOOLS"]

MAX_WAIT_SECONDS = 60.0
"""What tools wait at most: clients give a call up after a minute or so."""

Ctx: TypeAlias = Context[OpenGames, Any]
Handle = Annotated[
    str | None,
    Field(
        description="The handle that join returned. It may be left out where this server runs for "
        "you alone (stdio) and you are in one game.",
        max_length=64,
    ),
]
Seconds = Annotated[
    float,
    Field(description="How long to wait at most.", ge=0, le=MAX_WAIT_SECONDS, allow_inf_nan=False),
]
Code = Annotated[
    str,
    Field(description="The episode's code, such as KQXZB-MHTWA.", min_length=1, max_length=64),
]


async def list_episodes(ctx: Ctx) -> Annotated[CallToolResult, EpisodeList]:
    """List the episodes on the server that can be joined or watched. Takes the role of a host; \
with a lesser one, ask the user for a code."""
    with explained():
        async with _games(ctx).visit(caller_of(ctx)) as client:
            episodes = await client.episodes()
    rows = [
        EpisodeRow(
            code=episode.code,
            task=episode.task,
            clock=episode.clock,
            phase=episode.phase,
            step=episode.step,
            max_steps=episode.max_steps,
            seats=[SeatRow(player=s.player, name=s.name, kind=s.kind) for s in episode.seats],
            free_seats=[s.player for s in episode.seats if not s.name],
        )
        for episode in episodes
    ]
    words = "\n".join(map(episode_words, rows))
    return _result(EpisodeList(episodes=rows), words or "There is none; call create_episode.")


async def create_episode(
    ctx: Ctx,
    task: Annotated[
        str | None,
        Field(
            description="A task's name or the start of it: synchronous/01 to 10, asynchronous/01 "
            "to 10, multi_agent/01 to 10 (multi_agent/07@3 for three seats). The server's own if "
            "left out.",
            min_length=1,
            max_length=200,
        ),
    ] = None,
    clock: Annotated[
        Literal["turn", "lockstep", "realtime"] | None,
        Field(description="When steps are taken; the server's own if left out."),
    ] = None,
    seats: Annotated[int | None, Field(description="How many players.", ge=1, le=16)] = None,
    step_rate: Annotated[
        float | None, Field(description="Steps a second in real time.", gt=0, allow_inf_nan=False)
    ] = None,
    max_steps: Annotated[
        int | None, Field(description="The episode ends after so many steps.", ge=1)
    ] = None,
) -> Annotated[CallToolResult, Created]:
    """Open a new episode, without entering it: call join next. Takes the role of a host."""
    options = {"clock": clock, "seats": seats, "step_rate": step_rate, "max_steps": max_steps}
    with explained():
        async with _games(ctx).visit(caller_of(ctx)) as client:
            created = await client.create(task, **options)
    return _result(Created(code=created.code), f"The code is {created.code}. Call join with it.")


async def join(
    ctx: Ctx,
    episode: Code,
    seat: Annotated[
        str | None,
        Field(
            description="The player to be, such as robot2; any free one if left out.",
            min_length=1,
            max_length=64,
        ),
    ] = None,
    role: Annotated[
        Literal["player", "spectator"], Field(description="Spectators only watch and talk.")
    ] = "player",
    name: Annotated[
        str | None,
        Field(description="What the others call you.", min_length=1, max_length=40),
    ] = None,
) -> Annotated[CallToolResult, GameView]:
    """Enter an episode. Keep `game` of the answer: the other tools take it."""
    with explained():
        games = _games(ctx)
        opened = await games.join(caller_of(ctx, name), episode, seat, role)
        return _seen(opened.view())


async def observe(ctx: Ctx, game: Handle = None) -> Annotated[CallToolResult, GameView]:
    """Look at the kitchen now, and at what has happened since you last looked."""
    with explained(), _games(ctx).using(caller_of(ctx), game) as opened:
        return _seen(opened.view(whole=True))


async def list_actions(ctx: Ctx, game: Handle = None) -> Annotated[CallToolResult, ValidActions]:
    """List your valid actions now."""
    with explained(), _games(ctx).using(caller_of(ctx), game) as opened:
        row = ValidActions(
            step=opened.game.step, your_move=opened.your_move, actions=opened.actions
        )
        return _result(row, "\n".join(row.actions) or "You cannot act at present; call wait.")


async def act(
    ctx: Ctx,
    action: Annotated[
        str,
        Field(
            description="One of the valid actions, word for word.",
            min_length=1,
            max_length=MAX_SENTENCE,
        ),
    ],
    reasoning: Annotated[
        str | None,
        Field(description="Why; it is recorded, and shown to no player.", max_length=8000),
    ] = None,
    timeout_seconds: Seconds = 20,
    game: Handle = None,
) -> Annotated[CallToolResult, GameView]:
    """Do one action. The answer says what became of it, and shows the kitchen after it. An action \
that others have not let happen in time is `pending`: call wait to hear of it."""
    with explained(), _games(ctx).using(caller_of(ctx), game) as opened:
        if opened.game.phase == "waiting" and opened.game.seat is not None:
            raise ToolError("The game has not begun: it waits for other players. Call wait.")
        if opened.game.ended:
            raise ToolError("The episode is over. Call observe for its outcome, then leave.")
        return _seen(await opened.act(action, reasoning, timeout_seconds))


async def wait(
    ctx: Ctx,
    until: Annotated[
        Until,
        Field(description="change: until anything happens. my_move: until you can act."),
    ] = "change",
    timeout_seconds: Seconds = 20,
    game: Handle = None,
) -> Annotated[CallToolResult, GameView]:
    """Wait until something happens, or until it is your move, and say what happened since you \
last looked."""
    with explained(), _games(ctx).using(caller_of(ctx), game) as opened:
        return _seen(await opened.wait(until, timeout_seconds))


async def say(
    ctx: Ctx,
    text: Annotated[
        str, Field(description="Everybody in the episode reads it.", min_length=1, max_length=500)
    ],
    game: Handle = None,
) -> Annotated[CallToolResult, Spoken]:
    """Say something to everybody in the episode."""
    with explained(), _games(ctx).using(caller_of(ctx), game) as opened:
        if opened.game.ended:
            raise ToolError("The episode is over: nobody would hear it. Call leave.")
        if not await opened.say(text):
            raise ToolError(
                "It was not heard: you may not talk here, or talk too much, or the game server "
                "does not answer. Go on playing; observe tells whether it answers."
            )
        return _result(Spoken(text=text), "Said.")


async def leave(ctx: Ctx, game: Handle = None) -> Annotated[CallToolResult, Left]:
    """Leave the episode; your seat becomes free for others."""
    games = _games(ctx)
    with explained(), games.using(caller_of(ctx), game) as opened:
        await games.close(opened)
        return _result(Left(episode=opened.game.code), "You have left.")


TOOLS = (
    list_episodes,
    create_episode,
    join,
    observe,
    list_actions,
    act,
    wait,
    say,
    leave,
)


def _games(ctx: Ctx) -> OpenGames:
    return ctx.request_context.lifespan_context


def _seen(view: GameView) -> CallToolResult:
    return _result(view, view_words(view), *chat_words(view.chat))


def _result(content: BaseModel, *blocks: str) -> CallToolResult:
    texts: Sequence[Any] = [TextContent(type="text", text=block) for block in blocks]
    return CallToolResult(content=list(texts), structured_content=content.model_dump(mode="json"))
