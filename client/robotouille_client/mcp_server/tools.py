"""The MCP tools for playing on a game server."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from typing import Annotated, Any, Literal, TypeAlias

from mcp.server.mcpserver import Context
from mcp.server.mcpserver.exceptions import ToolError
from mcp.types import CallToolResult, TextContent
from pydantic import BaseModel, Field

from robotouille.world.text import MAX_SENTENCE
from robotouille_client.mcp_server.open_game import OpenGame, Until
from robotouille_client.mcp_server.open_games import OpenGames, caller_of
from robotouille_client.mcp_server.results import (
    EpisodeList,
    EpisodeSummary,
    GameView,
    LeftEpisode,
    NewEpisode,
    SeatSummary,
    SentChat,
    ValidActions,
    chat_words,
    episode_words,
    explained,
    view_words,
)
from robotouille_client.mcp_server.turns import end_turn

MAX_WAIT_SECONDS = 60.0
"""Maximum waiting time of a tool. MCP clients abandon calls after about a minute."""

Ctx: TypeAlias = Context[OpenGames, Any]
Handle = Annotated[
    str | None,
    Field(
        description="The handle that join returned. Optional if this server runs for you alone "
        "(stdio) and you are in one game.",
        max_length=64,
    ),
]
Seconds = Annotated[
    float,
    Field(description="Maximum waiting time.", ge=0, le=MAX_WAIT_SECONDS, allow_inf_nan=False),
]
Code = Annotated[
    str,
    Field(description="The episode's code, such as KQXZB-MHTWA.", min_length=1, max_length=64),
]


async def list_episodes(ctx: Ctx) -> Annotated[CallToolResult, EpisodeList]:
    """List the episodes on the server that can be joined or watched.

    This needs the role host; without it, ask the user for a code.
    """
    with explained():
        async with _games(ctx).visit(caller_of(ctx)) as client:
            episodes = await client.episodes()
    rows = [
        EpisodeSummary(
            code=episode.code,
            task=episode.task,
            clock=episode.clock,
            phase=episode.phase,
            step=episode.step,
            max_steps=episode.max_steps,
            seats=[SeatSummary(player=s.player, name=s.name, kind=s.kind) for s in episode.seats],
            free_seats=[s.player for s in episode.seats if not s.name],
        )
        for episode in episodes
    ]
    words = "\n".join(map(episode_words, rows))
    return _result(
        EpisodeList(episodes=rows), words or "There are no episodes; call create_episode."
    )


async def create_episode(
    ctx: Ctx,
    task: Annotated[
        str | None,
        Field(
            description="Name of a task, or its start: synchronous/01 to 10, asynchronous/01 "
            "to 10, multi_agent/01 to 10 (multi_agent/07@3 for three seats). Default: the "
            "server's own.",
            min_length=1,
            max_length=200,
        ),
    ] = None,
    clock: Annotated[
        Literal["turn", "lockstep", "realtime"] | None,
        Field(description="When steps are taken. Default: the server's own."),
    ] = None,
    seats: Annotated[int | None, Field(description="Number of players.", ge=1, le=16)] = None,
    step_rate: Annotated[
        float | None, Field(description="Steps per second in real time.", gt=0, allow_inf_nan=False)
    ] = None,
    max_steps: Annotated[int | None, Field(description="Step limit of the episode.", ge=1)] = None,
) -> Annotated[CallToolResult, NewEpisode]:
    """Open a new episode. Call join next to enter it. This needs the role host."""
    options = {"clock": clock, "seats": seats, "step_rate": step_rate, "max_steps": max_steps}
    with explained():
        async with _games(ctx).visit(caller_of(ctx)) as client:
            created = await client.create(task, **options)
    return _result(NewEpisode(code=created.code), f"The code is {created.code}. Call join with it.")


async def join(
    ctx: Ctx,
    episode: Code,
    seat: Annotated[
        str | None,
        Field(
            description="The player to control, such as robot2. Default: any free one.",
            min_length=1,
            max_length=64,
        ),
    ] = None,
    role: Annotated[
        Literal["player", "spectator"], Field(description="Spectators only watch and chat.")
    ] = "player",
    name: Annotated[
        str | None,
        Field(description="Your name in the episode.", min_length=1, max_length=40),
    ] = None,
) -> Annotated[CallToolResult, GameView]:
    """Join an episode. Keep `game` of the answer for the other tools."""
    with explained():
        games = _games(ctx)
        opened = await games.join(caller_of(ctx, name), episode, seat, role)
        return _seen(opened.view())


async def observe(ctx: Ctx, game: Handle = None) -> Annotated[CallToolResult, GameView]:
    """Show the kitchen now, and the events since your last call."""
    async with _called(ctx, game) as opened:
        return _seen(opened.view(whole=True))


async def list_actions(ctx: Ctx, game: Handle = None) -> Annotated[CallToolResult, ValidActions]:
    """List your valid actions now."""
    async with _called(ctx, game) as opened:
        row = opened.valid_actions()
        return _result(row, "\n".join(row.actions) or "You cannot act now; call wait.")


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
        Field(description="Your reasons, for the recording. No player sees them.", max_length=8000),
    ] = None,
    max_age: Annotated[
        int | None,
        Field(
            description="Reject the action if the kitchen has moved on by more steps than this "
            "since the last view that you received.",
            ge=0,
            le=1_000_000,
        ),
    ] = None,
    timeout_seconds: Seconds = 20,
    game: Handle = None,
) -> Annotated[CallToolResult, GameView]:
    """Do one action and return its result and the kitchen afterwards.

    An action that still waits for other players is `pending`: call wait for its result.
    """
    async with _called(ctx, game) as opened:
        if opened.game.phase == "waiting" and opened.game.seat is not None:
            raise ToolError("The game has not begun: it waits for other players. Call wait.")
        if opened.game.ended:
            raise ToolError("The episode has ended. Call observe for its outcome, then leave.")
        return _seen(await opened.act(action, reasoning, timeout_seconds, max_age))


async def wait(
    ctx: Ctx,
    until: Annotated[
        Until,
        Field(description="change: until anything happens. my_move: until you can act."),
    ] = "change",
    timeout_seconds: Seconds = 20,
    game: Handle = None,
) -> Annotated[CallToolResult, GameView]:
    """Wait for an event or for your move, and return the events since your last call."""
    async with _called(ctx, game) as opened:
        return _seen(await opened.wait(until, timeout_seconds))


async def say(
    ctx: Ctx,
    text: Annotated[
        str, Field(description="Text for all participants.", min_length=1, max_length=500)
    ],
    game: Handle = None,
) -> Annotated[CallToolResult, SentChat]:
    """Send a chat message to all participants."""
    async with _called(ctx, game) as opened:
        if opened.game.ended:
            raise ToolError("The episode has ended, so nobody would read it. Call leave.")
        if not await opened.say(text):
            raise ToolError(
                "The message was not delivered: you may not chat here, you chat too much, or the "
                "game server does not answer. Continue to play; observe shows `connected`."
            )
        return _result(SentChat(text=text), "Sent.")


async def leave(ctx: Ctx, game: Handle = None) -> Annotated[CallToolResult, LeftEpisode]:
    """Leave the episode and free your seat."""
    async with _called(ctx, game) as opened:
        await _games(ctx).close(opened)
        return _result(LeftEpisode(episode=opened.game.code), "You have left.")


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


@asynccontextmanager
async def _called(ctx: Ctx, game: str | None) -> AsyncIterator[OpenGame]:
    """Open the caller's game for one call."""
    with explained():
        async with _games(ctx).using(caller_of(ctx), game) as opened:
            try:
                yield opened
            finally:
                end_turn()


def _seen(view: GameView) -> CallToolResult:
    return _result(view, view_words(view), *chat_words(view.chat))


def _result(content: BaseModel, *blocks: str) -> CallToolResult:
    texts: Sequence[Any] = [TextContent(type="text", text=block) for block in blocks]
    return CallToolResult(content=list(texts), structured_content=content.model_dump(mode="json"))
