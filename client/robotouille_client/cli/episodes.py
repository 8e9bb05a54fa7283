"""`robotouille episodes`: the episodes of a study on a server, opened, listed and closed."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.program import printable, tell
from robotouille.protocol import messages
from robotouille_client.cli.episode_table import (
    TableError,
    closed_codes,
    listed_row,
    read_requests,
    seconds,
    write_table,
)
from robotouille_client.client import DEFAULT_URL, Client, connect
from robotouille_client.console import TokenOption, explain, fail, failing, name_and_value

__all__ = ["episodes"]

T = TypeVar("T")
U = TypeVar("U")

AT_ONCE = 32
"""Requests that are sent before the first is answered."""
TELL_EVERY = 100
NAME = "episodes"

episodes = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    help="Open, list and close the episodes of a study on a server, from and to CSV.",
)
UrlOption = Annotated[str, typer.Option(help="The server.")]
LabelOption = Annotated[
    list[str] | None, typer.Option("--label", help="Only those with this label: NAME=VALUE.")
]
OutOption = Annotated[
    Path | None, typer.Option("--out", help="File to write; standard output if left out.")
]


@episodes.command("open")
@failing
def open_(
    table: Annotated[Path, typer.Argument(help="CSV: a row an episode; the column task at least.")],
    out: OutOption = None,
    open_for: Annotated[
        str, typer.Option(help="How long a code is good that nobody uses: 12h, 30d.")
    ] = "7d",
    tokens: Annotated[
        bool, typer.Option("--tokens", help="A signed role token for each seat, too.")
    ] = False,
    url: UrlOption = DEFAULT_URL,
    token: TokenOption = None,
) -> None:
    """Open an episode for each row of a CSV file; write the rows with their codes."""
    if out is not None and out.exists():
        fail(printable(f"{out}: there is such a file, with codes perhaps: name another one"), 2)
    rows, requests = read_requests(table, open_for=seconds(open_for), tokens=tokens)
    opened: list[dict[str, Any]] = []

    async def open_all(client: Client) -> None:
        def noted(at: int, created: messages.Created) -> None:
            signed = {f"token.{player}": each for player, each in created.tokens.items()}
            told = {"code": created.code, "episode": created.episode, **signed}
            opened.append({**rows[at], **told})

        async def create(line: int, request: messages.Create) -> messages.Created:
            try:
                return await _create(client, request)
            except ProtocolError as error:
                raise TableError(f"{table}: line {line}: {explain(error)}") from None

        lines = list(enumerate(requests, 2))
        await _each(lines, lambda row: create(*row), noted, "opened")

    try:
        _with_client(url, token, open_all)
    except RobotouilleError as error:
        if opened:
            tell(f"{len(opened)} of {len(rows)} are open, and written", err=True)
        raise RobotouilleError(explain(error)) from None
    finally:
        if opened:
            write_table(opened, out, secret=tokens)
    tell(f"{len(opened)} opened", err=True)


@episodes.command("list")
@failing
def list_(
    label: LabelOption = None,
    closed: Annotated[
        bool, typer.Option("--closed", help="Those that were closed because nobody came.")
    ] = False,
    out: OutOption = None,
    url: UrlOption = DEFAULT_URL,
    token: TokenOption = None,
) -> None:
    """Write the episodes of a server as CSV."""
    labels = _labels(label)
    found = _with_client(url, token, lambda client: client.episodes(labels, closed=closed))
    if found:
        now = datetime.now(UTC)
        write_table([listed_row(one, now) for one in found], out, secret=False)
    tell(f"{len(found)} episode{'s' * (len(found) != 1)}", err=True)


@episodes.command()
@failing
def close(
    codes: Annotated[list[str] | None, typer.Argument(help="Codes or ids.")] = None,
    table: Annotated[
        Path | None, typer.Option("--from", help="CSV with a column code, as `open` writes it.")
    ] = None,
    label: LabelOption = None,
    playing: Annotated[
        bool, typer.Option("--playing", help="With --label or --from: those that are played, too.")
    ] = False,
    reason: Annotated[str | None, typer.Option(help="What those in them are told.")] = None,
    url: UrlOption = DEFAULT_URL,
    token: TokenOption = None,
) -> None:
    """Close episodes that one has opened; an operator closes any."""
    named, labels = list(codes or ()), _labels(label)
    listed = set(closed_codes(table)) if table is not None else set()
    if not (named or labels or listed):
        fail("say which: by codes, --from FILE or --label NAME=VALUE", 2)

    async def close_all(client: Client) -> int:
        wanted = list(named)
        if labels or listed:
            for one in await client.episodes(labels):
                chosen = not listed or one.code in listed or one.episode in listed
                if chosen and (one.phase == "waiting" or (playing and one.phase != "over")):
                    wanted.append(one.episode)
        await _each(
            wanted, lambda code: client.close_episode(code, reason), lambda *_: None, "closed"
        )
        return len(wanted)

    tell(f"{_with_client(url, token, close_all)} closed", err=True)


async def _create(client: Client, request: messages.Create) -> messages.Created:
    fields = {name: getattr(request, name) for name in request.model_fields_set}
    return await client.create(fields.pop("task", None), **fields)


async def _each(
    items: list[T],
    ask: Callable[[T], Awaitable[U]],
    noted: Callable[[int, U], None],
    done: str,
) -> None:
    """Ask for each item, some at a time, and take the answers in order; nothing new is asked for
    once one was refused."""
    for first in range(0, len(items), AT_ONCE):
        batch = items[first : first + AT_ONCE]
        answers = await asyncio.gather(*map(ask, batch), return_exceptions=True)
        refused: BaseException | None = None
        for at, answer in enumerate(answers, first):
            if isinstance(answer, BaseException):
                refused = refused or answer
            else:
                noted(at, answer)
        if refused is not None:
            raise refused
        last = first + len(batch)
        if last // TELL_EVERY > first // TELL_EVERY:
            tell(f"{last} of {len(items)} {done}", err=True)


def _labels(pairs: list[str] | None) -> Mapping[str, str]:
    return dict(name_and_value(pair, "--label") for pair in pairs or ())


def _with_client(url: str, token: str | None, work: Callable[[Client], Awaitable[T]]) -> T:
    async def main() -> T:
        async with connect(url, name=NAME, kind="bot", token=token, reconnect=False) as client:
            return await work(client)

    return asyncio.run(main())
