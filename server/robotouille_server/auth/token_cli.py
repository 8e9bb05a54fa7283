"""Command `robotouille-token`: creates, shows and revokes role tokens, and rotates keys."""

from __future__ import annotations

import json
import os
import re
import secrets
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.terminal import (
    one_of,
    options_from,
    printable,
    printable_json,
    tell,
    version_option,
)
from robotouille_server.auth.keys import (
    KEPT_KEYS,
    MAX_KEYS,
    SIGNING_KEYS_VARIABLE,
    FileKeyring,
    Keyring,
    load,
    rotate,
)
from robotouille_server.auth.links import is_link
from robotouille_server.auth.revocation import REVOKED_FILE, load_revoked, revoke
from robotouille_server.auth.roles import Role
from robotouille_server.auth.tokens import RoleGrant, Tokens

KEYS_VARIABLE = "ROBOTOUILLE_KEYS"
STDIN = "-"
KeysOption = Annotated[
    Path,
    typer.Option("--keys", envvar=KEYS_VARIABLE, help="The server's key file.", show_default=True),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
MAX_DAYS = 3650
DEFAULT_KEYS = Path("recordings.state/keys.json")
_TOKEN_ID = re.compile(r"[!-~]{1,64}")


def token_app(wall: Callable[[], float] = time.time) -> typer.Typer:
    """Return the command. `wall` returns the time in seconds since 1970."""
    app = typer.Typer(
        add_completion=False,
        no_args_is_help=True,
        rich_markup_mode="rich",
        help="Create and revoke signed tokens, which state what their bearers may do on a server.",
    )

    @app.callback()
    def options(version: Annotated[bool, version_option()] = False) -> None: ...

    _add_mint(app, wall)
    _add_show(app, wall)
    _add_rotate(app)
    _add_revoke(app, wall)
    return app


@dataclass(frozen=True)
class MintOptions:
    """Flags of `robotouille-token mint`."""

    subject: Annotated[
        str | None,
        typer.Option(help="Pseudonym of the bearer, which is recorded. Default: random."),
    ] = None
    name: Annotated[str, typer.Option(help="Name to show, whatever the bearer's client sends.")] = (
        ""
    )
    episode: Annotated[str, typer.Option(help="Only for the episode with this id or code.")] = ""
    seat: Annotated[str, typer.Option(help="Only for this seat, such as robot2.")] = ""
    hours: Annotated[
        float | None, typer.Option(min=0.01, max=MAX_DAYS * 24, help="Hours of validity.")
    ] = None
    days: Annotated[
        float | None,
        typer.Option(min=0.01, max=MAX_DAYS, help="Days of validity. Default: 1 day."),
    ] = None
    once: Annotated[
        bool, typer.Option("--once", help="Valid for one session: the first that joins.")
    ] = False
    link: Annotated[
        str,
        typer.Option(
            help="Print a personal link for the page at this address, with --episode CODE: "
            "https://HOST/play for a player, https://HOST/watch for a spectator.",
        ),
    ] = ""
    keys: KeysOption = DEFAULT_KEYS
    as_json: JsonOption = False


def _add_mint(app: typer.Typer, wall: Callable[[], float]) -> None:
    @app.command("mint")
    @options_from(MintOptions)
    def mint(
        role: Annotated[
            Role,
            typer.Argument(parser=one_of(Role), help="Role of the bearer.", show_default=False),
        ],
        options: MintOptions,
    ) -> None:
        """Create a role token and print it."""
        with _reported():
            _check_once(role, options.once)
            _check_link(role, options)
            tokens = Tokens(_keyring(options.keys), wall)
            token = _minted(tokens, role, options)
            grant = tokens.check_role(token)
        if options.link:
            token = f"{options.link}#{token}"
        if options.as_json:
            print(printable_json(json.dumps({"token": token, **_plain(grant)}, ensure_ascii=False)))
        else:
            tell(token)
            tell(printable(f"{_sentence(grant)}."), err=True)


def _add_show(app: typer.Typer, wall: Callable[[], float]) -> None:
    @app.command("show")
    def show(
        token: Annotated[str, typer.Argument(help="The token; - reads it from standard input.")],
        keys: KeysOption = DEFAULT_KEYS,
        as_json: JsonOption = False,
    ) -> None:
        """Show what a role token grants. Exit status 1 if servers refuse it."""
        with _reported():
            grant = Tokens(_keyring(keys), wall).check_role(_given(token).rpartition("#")[2])
            revoked = grant.token_id in load_revoked(keys.with_name(REVOKED_FILE))
        if as_json:
            plain = {**_plain(grant), "revoked": revoked}
            print(printable_json(json.dumps(plain, ensure_ascii=False)))
        else:
            tell(printable(f"{_sentence(grant)}{': revoked' if revoked else ''}."))
        if revoked:
            raise typer.Exit(1)


def _add_rotate(app: typer.Typer) -> None:
    @app.command("rotate")
    def rotate_keys(
        keep: Annotated[
            int,
            typer.Option(
                min=1, max=MAX_KEYS, help="Number of keys to keep, including the new one."
            ),
        ] = KEPT_KEYS,
        keys: KeysOption = DEFAULT_KEYS,
        as_json: JsonOption = False,
    ) -> None:
        """Add a new signing key. Running servers use it at once.

        The key file is created if it is missing. Tokens signed with dropped keys become invalid.
        """
        with _reported():
            before = {key.kid for key in load(keys)} if keys.exists() else set()
            new = rotate(keys, keep=keep)
            kept = [key.kid for key in load(keys)]
        dropped = sorted(before - set(kept))
        if as_json:
            print(json.dumps({"file": str(keys), "keys": kept, "dropped": dropped}))
            return
        file = printable(str(keys))
        tell(f"{file}: new tokens are signed with {new.kid}; {_listed(kept[1:])} still valid")
        if dropped:
            tell(f"tokens signed with {_listed(dropped)} are invalid now")


def _add_revoke(app: typer.Typer, wall: Callable[[], float]) -> None:
    @app.command("revoke")
    def revoke_token(
        token: Annotated[
            str, typer.Argument(help="The token, or its id; - reads it from standard input.")
        ],
        keys: KeysOption = DEFAULT_KEYS,
        as_json: JsonOption = False,
    ) -> None:
        """Revoke a token.

        Within two seconds, running servers refuse it and close the connections that used it. These
        connections cannot be resumed.
        """
        path = keys.with_name(REVOKED_FILE)
        with _reported():
            token_id, expires = _identified(_given(token), keys, wall)
            revoke(path, [token_id], expires, wall())
        if as_json:
            print(json.dumps({"file": str(path), "token_id": token_id}))
        else:
            tell(printable(f"{path}: the token {token_id} is revoked"))


def _check_once(role: Role, once: bool) -> None:
    if once and role.includes(Role.HOST):
        raise RobotouilleError(f"--once is for players and spectators, not for the role {role}")


def _check_link(role: Role, options: MintOptions) -> None:
    if not options.link:
        return
    if role.includes(Role.HOST) or options.name:
        raise RobotouilleError("--link is for players and spectators, and has no room for --name")
    if not re.fullmatch(r"https?://[^\s#?]+", options.link):
        text = f"--link: {options.link!r} is not the page's address; expected https://HOST/play"
        raise RobotouilleError(text)


def _given(token: str) -> str:
    return sys.stdin.read().strip() if token == STDIN else token.strip()


def _identified(text: str, keys: Path, wall: Callable[[], float]) -> tuple[str, float]:
    """Return the id and latest expiry time of a token. `text` is the token or its id."""
    text = text.rpartition("#")[2]
    if text.count(".") == 2 or is_link(text):
        grant = Tokens(_keyring(keys), wall).check_role(text)
        return grant.token_id, grant.expires
    if not _TOKEN_ID.fullmatch(text):
        raise RobotouilleError("expected a token or its id; `robotouille-token show` prints the id")
    _keyring(keys)
    return text, wall() + MAX_DAYS * 86400


def _minted(tokens: Tokens, role: Role, options: MintOptions) -> str:
    hours = (options.hours or 0) + 24 * (options.days or 0) or 24
    subject = options.subject if options.subject is not None else f"p-{secrets.token_hex(4)}"
    seconds = 3600 * hours
    try:
        if options.link:
            return tokens.mint_link(
                subject,
                seconds=seconds,
                code=options.episode,
                seat=options.seat,
                once=options.once,
                watch=role is Role.SPECTATOR,
            )
        return tokens.mint_role(
            role,
            subject,
            seconds=seconds,
            name=options.name,
            episode=options.episode,
            seat=options.seat,
            once=options.once,
        )
    except ValueError as error:
        raise RobotouilleError(f"invalid value for a token: {error}") from None


def _keyring(path: Path) -> Keyring:
    """Return the keys of the environment or, without them, of the file.

    A missing file is not created: the server would not accept tokens signed with a new key.
    """
    text = os.environ.get(SIGNING_KEYS_VARIABLE)
    if text:
        return Keyring.parse(text)
    load(path)
    return FileKeyring(path)


def _plain(grant: RoleGrant) -> dict[str, Any]:
    plain = asdict(grant)
    plain["expires"] = _time(grant.expires)
    return plain


def _time(seconds: float) -> str:
    try:
        return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    except (OverflowError, ValueError):
        return "the end of time"


def _sentence(grant: RoleGrant) -> str:
    words = [f"{grant.role} {grant.subject}"]
    words += [f"named {grant.name}"] if grant.name else []
    words += [f"only in the episode {grant.episode}"] if grant.episode else []
    words += [f"only in the seat {grant.seat}"] if grant.seat else []
    words += ["valid for one session"] if grant.once else []
    return f"{', '.join(words)}, until {_time(grant.expires)}, id {grant.token_id}"


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "no others"


@contextmanager
def _reported() -> Iterator[None]:
    """Print expected errors in one line and exit with status 1."""
    try:
        yield
    except ProtocolError as error:
        tell(printable(f"robotouille-token: {error.code}: {error.message}"), err=True)
        raise typer.Exit(1) from None
    except (RobotouilleError, OSError) as error:
        tell(printable(f"robotouille-token: {error}"), err=True)
        raise typer.Exit(1) from None


def main() -> None:
    """Run `robotouille-token`."""
    token_app()()


if __name__ == "__main__":
    main()
