"""Commands `robotouille episodes …`: open, list and close the episodes of a study, with CSV."""

from __future__ import annotations

import asyncio
import csv
import re
import sys
from collections import Counter
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, contextmanager
from datetime import UTC, datetime, timedelta
from io import StringIO
from pathlib import Path
from typing import IO, Annotated, Any, TypeVar

import typer
from pydantic import ValidationError

from robotouille.errors import Fault, FileError, ProtocolError, RobotouilleError
from robotouille.files.reading import read_bytes
from robotouille.files.writing import check_file, whole_file
from robotouille.protocol import messages
from robotouille.replay.file_names import iso_time
from robotouille.terminal import csv_cell, printable, tell
from robotouille_client.client import DEFAULT_URL, Client, connect
from robotouille_client.console import TokenOption, explain, fail, failing, name_and_value

MAX_ROWS = 10_000
MAX_BYTES = 64 * 1024 * 1024
"""Bytes of a table. Tables that `open` writes have a token and a link for each seat."""
MAX_CLOSES = 366 * 86_400
UNITS = {"": 1, "s": 1, "m": 60, "h": 3600, "d": 86_400}
NUMBERS = {
    "seats": int, "max_steps": int, "seed": int, "sight": int, "step_rate": float,
    "move_budget": float, "grace": float,
}  # fmt: skip
WORDS = ("task", "clock", "timing", "thinking", "absence", "substitute", "chat")
COLUMNS = (*WORDS, *NUMBERS, "open_for", "phrases", "sight_blocked")
GROUPS = ("label", "shown_as", "delay_ms", "participant")
"""Prefixes of columns `GROUP.NAME`, where NAME is a label or a player."""


class TableError(RobotouilleError):
    """An invalid CSV table."""


def seconds(text: str) -> float:
    """Return a duration in seconds, from a number with an optional unit: `90m`, `12h`, `30d`.

    Raises:
        TableError: The text is not a duration.
    """
    found = re.fullmatch(r"(\d+(?:\.\d+)?)([smhd]?)", text.strip())
    if found is None:
        raise TableError(f"{text!r} is not a duration; expected one like 90, 15m, 12h or 30d")
    return float(found[1]) * UNITS[found[2]]


def read_requests(
    path: Path, **defaults: Any
) -> tuple[list[dict[str, str]], list[messages.Create]]:
    """Return the rows of a table and the request that each row describes.

    Args:
        defaults: Fields of requests whose cell is empty.

    Raises:
        TableError: The file cannot be read, or a column is missing or unknown.
        FileError: Values are invalid. The error lists the faults of all rows.
    """
    rows = _read(path)
    if not rows:
        raise TableError(f"{path}: no rows below the heading")
    requests: list[messages.Create] = []
    faults: list[Fault] = []
    for number, row in enumerate(rows, 2):
        try:
            requests.append(messages.Create(**{**defaults, **_fields(row)}))
        except (TableError, ValueError) as error:
            faults += [Fault(f"line {number}", text) for text in _texts(error)]
    if faults:
        raise FileError(str(path), faults)
    return rows, requests


def _texts(error: Exception) -> list[str]:
    """Return the faults of a row as texts."""
    if not isinstance(error, ValidationError):
        return [str(error)]
    found = error.errors(include_url=False)
    return [f"{'.'.join(map(str, each['loc']))}: {each['msg']}" for each in found]


def closed_codes(path: Path) -> list[str]:
    """Return the column `code` of a table.

    Raises:
        TableError: The table has no such column.
    """
    rows = _read(path, columns=None)
    if not rows or "code" not in rows[0]:
        raise TableError(f"{path}: no column 'code'")
    return [row["code"] for row in rows if row["code"]]


def _read(path: Path, columns: Sequence[str] | None = COLUMNS) -> list[dict[str, str]]:
    try:
        text = read_bytes(path, MAX_BYTES).decode("utf-8-sig")
        reader = csv.DictReader(StringIO(text, newline=""), strict=True)
        if columns is not None:
            _check_columns(path, reader.fieldnames or [])
        return list(_rows(path, reader))
    except OSError as error:
        raise TableError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise TableError(f"{path}: is not UTF-8 text") from None
    except csv.Error as error:
        raise TableError(f"{path}: is not valid CSV: {error}") from None


def _check_columns(path: Path, names: Sequence[str]) -> None:
    if "task" not in names:
        semicolons = "; use commas, not semicolons" if any(";" in name for name in names) else ""
        raise TableError(f"{path}: no column 'task'{semicolons}")
    for name in names:
        group, dot, of = name.partition(".")
        if name not in COLUMNS and not (dot and of and group in GROUPS):
            known = ", ".join((*COLUMNS, *(f"{group}.NAME" for group in GROUPS)))
            raise TableError(f"{path}: unknown column {name!r}; expected {known}")
    if twice := next((name for name, count in Counter(names).items() if count > 1), None):
        raise TableError(f"{path}: duplicate column {twice!r}")


def _rows(path: Path, reader: csv.DictReader[str]) -> Iterator[dict[str, str]]:
    for number, row in enumerate(reader, 1):
        if number > MAX_ROWS:
            raise TableError(f"{path}: has more than {MAX_ROWS:,} rows")
        if None in row or None in row.values():
            found = "more" if None in row else "fewer"
            raise TableError(f"{path}: line {reader.line_num}: {found} values than columns")
        yield {name: value.strip() for name, value in row.items()}


def _fields(row: Mapping[str, str]) -> dict[str, Any]:
    """Return the fields of a `create` message for the cells of a row that are not empty."""
    fields: dict[str, Any] = {}
    treatments: dict[str, dict[str, Any]] = {}
    for name, value in row.items():
        group, _, of = name.partition(".")
        if not value:
            continue
        if group == "label":
            fields.setdefault("labels", {})[of] = value
        elif group == "participant":
            fields.setdefault("participants", {})[of] = value
        elif group == "shown_as":
            treatments.setdefault(of, {})["shown_as"] = value
        elif group == "delay_ms":
            treatments.setdefault(of, {})["delay_ms"] = _number(int, name, value)
        elif name == "open_for":
            fields[name] = seconds(value)
        elif name == "sight_blocked":
            fields[name] = _truth(name, value)
        elif name == "phrases":
            fields[name] = [phrase.strip() for phrase in value.split("|")]
        else:
            fields[name] = _number(NUMBERS[name], name, value) if name in NUMBERS else value
    return {**fields, **({"treatments": treatments} if treatments else {})}


def _truth(name: str, value: str) -> bool:
    if value.lower() not in ("true", "false"):
        raise TableError(f"{name}: {value!r} is neither true nor false")
    return value.lower() == "true"


def _number(kind: type[int] | type[float], name: str, value: str) -> float:
    try:
        return kind(value)
    except ValueError:
        raise TableError(f"{name}: {value!r} is not a number") from None


def listed_row(info: messages.EpisodeInfo, now: datetime) -> dict[str, Any]:
    """Return the row of an episode in a list that was received at `now`."""
    closes = ""
    # Servers keep episodes open for a year at most, and later times have no date.
    if info.closes is not None and 0 <= info.closes <= MAX_CLOSES:
        closes = (now + timedelta(seconds=info.closes)).strftime("%Y-%m-%dT%H:%M:%SZ")
    seats = (f"{seat.player}: {seat.name}" for seat in info.seats if seat.name)
    row = {
        "code": info.code,
        "episode": info.episode,
        "task": info.task,
        "clock": str(info.clock),
        "phase": str(info.phase),
        "step": info.step,
        "max_steps": info.max_steps,
        "seats": "; ".join(seats),
        "spectators": info.spectators,
        "sight": "" if info.sight is None else info.sight,
        "sight_blocked": str(info.sight_blocked).lower(),
        "created": iso_time(info.created),
        "closes": closes,
        "reason": info.reason,
        "detail": info.detail,
        **{f"label.{name}": value for name, value in info.labels.items()},
    }
    # Names come from participants, and a spreadsheet must not run them as formulas.
    return {
        name: csv_cell(value) if isinstance(value, str) else value for name, value in row.items()
    }


def write_table(rows: Iterable[Mapping[str, Any]], path: Path | None, *, secret: bool) -> None:
    """Write rows as CSV to a file or to standard output.

    Args:
        secret: Make the file readable by its owner only, because codes and tokens grant access.

    On standard output, which may be a terminal, control characters are replaced.

    Raises:
        TableError: The file cannot be written.
    """
    rows = list(rows)
    columns = list(dict.fromkeys(name for row in rows for name in row))
    try:
        with _opened(path, secret=secret) as file:
            names = columns if path is not None else list(map(printable, columns))
            writer = csv.DictWriter(file, names, restval="", lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows if path is not None else map(_printable, rows))
    except OSError as error:
        raise TableError(f"{path}: cannot be written: {error.strerror or error}") from None


def page_address(url: str) -> str:
    """Return the address of a server's page; of several servers, that of the first one."""
    site = url.partition(",")[0].rstrip("/")
    return f"http{site.removeprefix('ws')}/play"


def _printable(row: Mapping[str, Any]) -> dict[str, Any]:
    return {
        printable(name): printable(value) if isinstance(value, str) else value
        for name, value in row.items()
    }


@contextmanager
def _opened(path: Path | None, *, secret: bool) -> Iterator[IO[str]]:
    if path is None:
        yield sys.stdout
        return
    with whole_file(path, mode=0o600 if secret else 0o666) as file:
        yield file


T = TypeVar("T")
U = TypeVar("U")

AT_ONCE = 32
"""Number of requests that wait for an answer at a time."""
REPORT_EVERY = 100
"""Number of episodes between two lines of progress."""
NAME = "episodes"

episodes = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    help="Open, list and close the episodes of a study on a server, from and to CSV.",
)
UrlOption = Annotated[
    str,
    typer.Option(help="URL of the server, or several URLs of its nodes with commas between them."),
]
LabelOption = Annotated[
    list[str] | None, typer.Option("--label", help="Only episodes with this label: NAME=VALUE.")
]
OutOption = Annotated[
    Path | None, typer.Option("--out", help="File to write. Default: standard output.")
]


@episodes.command("open")
@failing
def open_(
    table: Annotated[
        Path,
        typer.Argument(help="CSV with one row for each episode, and at least the column task."),
    ],
    out: OutOption = None,
    open_for: Annotated[
        str, typer.Option(help="Time after which an unused episode closes: 12h, 30d.")
    ] = "7d",
    tokens: Annotated[
        bool, typer.Option("--tokens", help="Add a role token and a personal link for each seat.")
    ] = False,
    page: Annotated[
        str, typer.Option(help="Address of the page in links. Default: from the URL.")
    ] = "",
    url: UrlOption = DEFAULT_URL,
    token: TokenOption = None,
) -> None:
    """Open an episode for each row of a CSV file, and write the rows with their codes."""
    if out is not None and out.exists():
        fail(printable(f"{out} exists and may contain codes; name another file"), 2)
    if out is not None:
        check_file(out)
    rows, requests = read_requests(table, open_for=seconds(open_for), tokens=tokens)
    opened: list[dict[str, Any]] = []
    site = page or page_address(url)

    async def open_all(clients: Sequence[Client]) -> None:
        def record(at: int, created: messages.Created) -> None:
            signed = {f"token.{player}": each for player, each in created.tokens.items()}
            signed |= {f"link.{p}": f"{site}#{each}" for p, each in created.links.items()}
            names = {"code": created.code, "episode": created.episode}
            made = {name: csv_cell(value) for name, value in {**names, **signed}.items()}
            opened.append({**rows[at], **made})

        async def create(line: int, request: messages.Create) -> messages.Created:
            try:
                return await _create(clients[line % len(clients)], request)
            except ProtocolError as error:
                raise TableError(f"{table}: line {line}: {explain(error)}") from None

        lines = list(enumerate(requests, 2))
        await _each(lines, lambda row: create(*row), record, "opened")

    try:
        _with_clients(url, token, open_all)
    except RobotouilleError as error:
        if opened:
            tell(f"{len(opened)} of {len(rows)} episodes are open and were written", err=True)
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
        bool, typer.Option("--closed", help="List episodes that closed because nobody came.")
    ] = False,
    out: OutOption = None,
    url: UrlOption = DEFAULT_URL,
    token: TokenOption = None,
) -> None:
    """List the episodes of a server as CSV."""
    if out is not None:
        check_file(out)
    labels = _labels(label)

    async def list_all(clients: Sequence[Client]) -> list[messages.EpisodeInfo]:
        return [one for _, one in await _listed(clients, labels, closed=closed)]

    found = _with_clients(url, token, list_all)
    if found:
        now = datetime.now(UTC)
        write_table([listed_row(one, now) for one in found], out, secret=False)
    tell(f"{len(found)} episode{'s' * (len(found) != 1)}", err=True)


@episodes.command()
@failing
def close(
    codes: Annotated[list[str] | None, typer.Argument(help="Codes or ids.")] = None,
    table: Annotated[
        Path | None, typer.Option("--from", help="CSV with a column code, such as `open` writes.")
    ] = None,
    label: LabelOption = None,
    playing: Annotated[
        bool,
        typer.Option(
            "--playing", help="With --label or --from: also close episodes that have begun."
        ),
    ] = False,
    reason: Annotated[str | None, typer.Option(help="Text for their participants.")] = None,
    url: UrlOption = DEFAULT_URL,
    token: TokenOption = None,
) -> None:
    """Close episodes that you have opened. Operators can close any."""
    named, labels = list(codes or ()), _labels(label)
    listed = set(closed_codes(table)) if table is not None else set()
    if not (named or labels or listed):
        fail("name the episodes: codes, --from FILE or --label NAME=VALUE", 2)

    async def close_all(clients: Sequence[Client]) -> int:
        # A process redirects clients that name an episode of another one, which is slow for many.
        known = await _listed(clients, {}) if named and len(clients) > 1 else []
        homes = {name: client for client, one in known for name in (one.code, one.episode)}
        wanted = [(homes.get(code, clients[0]), code) for code in named]
        if labels or listed:
            for client, one in await _listed(clients, labels):
                chosen = not listed or one.code in listed or one.episode in listed
                if chosen and (one.phase == "waiting" or (playing and one.phase != "ended")):
                    wanted.append((client, one.episode))
        # Each request may move the connection to another node, so they cannot overlap.
        at_once = 1 if clients[0].other_urls else AT_ONCE
        await _each(
            wanted,
            lambda each: each[0].close_episode(each[1], reason),
            lambda *_: None,
            "closed",
            at_once,
        )
        return len(wanted)

    tell(f"{_with_clients(url, token, close_all)} closed", err=True)


async def _listed(
    clients: Sequence[Client], labels: Mapping[str, str], *, closed: bool = False
) -> list[tuple[Client, messages.EpisodeInfo]]:
    """Return the episodes of all clients' processes, each with its client."""
    return [(each, one) for each in clients for one in await each.episodes(labels, closed=closed)]


async def _create(client: Client, request: messages.Create) -> messages.Created:
    fields = {name: getattr(request, name) for name in request.model_fields_set}
    return await client.create(fields.pop("task", None), **fields)


async def _each(
    items: list[T],
    ask: Callable[[T], Awaitable[U]],
    record: Callable[[int, U], None],
    done: str,
    at_once: int = AT_ONCE,
) -> None:
    """Send a request for each item, a batch at a time, and record the answers in order.

    After a refused request the current batch is completed, because its episodes may be open.
    """
    for first in range(0, len(items), at_once):
        batch = items[first : first + at_once]
        answers = await asyncio.gather(*map(ask, batch), return_exceptions=True)
        refused: BaseException | None = None
        for at, answer in enumerate(answers, first):
            if isinstance(answer, BaseException):
                refused = refused or answer
            else:
                record(at, answer)
        if refused is not None:
            raise refused
        last = first + len(batch)
        if last // REPORT_EVERY > first // REPORT_EVERY:
            tell(f"{last} of {len(items)} {done}", err=True)


def _labels(pairs: list[str] | None) -> Mapping[str, str]:
    return dict(name_and_value(pair, "--label") for pair in pairs or ())


def _with_clients(
    url: str, token: str | None, work: Callable[[Sequence[Client]], Awaitable[T]]
) -> T:
    """Run `work` with a client for each process of the server."""

    async def main() -> T:
        async with AsyncExitStack() as stack:

            async def client(url: str) -> Client:
                connected = connect(url, name=NAME, kind="bot", token=token, reconnect=False)
                return await stack.enter_async_context(connected)

            first = await client(url)
            return await work([await client(each) for each in first.worker_urls] or [first])

    return asyncio.run(main())
