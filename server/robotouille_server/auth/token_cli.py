"""`robotouille-token`: make, show and revoke role tokens, rotate the keys that sign them."""

from __future__ import annotations

import json
import os
import re
import secrets
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.program import VersionOption, printable, printable_json, tell
from robotouille_server.auth.keys import (
    KEPT_KEYS,
    MAX_KEYS,
    SIGNING_KEYS_VARIABLE,
    FileKeyring,
    Keyring,
    load,
    rotate,
)
from robotouille_server.auth.revocation import REVOKED_FILE, load_revoked, revoke
from robotouille_server.auth.roles import Role
from robotouille_server.auth.tokens import RoleGrant, Tokens

__all__ = ["main", "token_app"]

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
    """The command; `wall` gives the time in seconds since 1970."""
    app = typer.Typer(
        add_completion=False,
        no_args_is_help=True,
        rich_markup_mode="rich",
        help="Make, and take back, the signed tokens that say what somebody may do on a server.",
    )

    @app.callback()
    def options(version: VersionOption = False) -> None: ...

    _add_mint(app, wall)
    _add_show(app, wall)
    _add_rotate(app)
    _add_revoke(app, wall)
    return app


def _add_mint(app: typer.Typer, wall: Callable[[], float]) -> None:
    @app.command("mint")
    def mint(
        role: Annotated[Role, typer.Argument(help="What the bearer may do.", show_default=False)],
        subject: Annotated[
            str | None,
            typer.Option(help="Pseudonym of the bearer; it is recorded. Random if left out."),
        ] = None,
        name: Annotated[
            str, typer.Option(help="Name to be shown, whatever the bearer's client says.")
        ] = "",
        episode: Annotated[str, typer.Option(help="Only for the episode of this id or code.")] = "",
        seat: Annotated[str, typer.Option(help="Only for this seat, e.g. robot2.")] = "",
        hours: Annotated[
            float | None, typer.Option(min=0.01, max=MAX_DAYS * 24, help="Good for so many hours.")
        ] = None,
        days: Annotated[
            float | None,
            typer.Option(min=0.01, max=MAX_DAYS, help="… and so many days; 1 day if neither."),
        ] = None,
        once: Annotated[
            bool, typer.Option("--once", help="Good for one session: the first that joins.")
        ] = False,
        keys: KeysOption = DEFAULT_KEYS,
        as_json: JsonOption = False,
    ) -> None:
        """Make a role token and print it."""
        seconds = 3600 * (hours or 0) + 86400 * (days or 0) or 86400
        whom = subject if subject is not None else f"p-{secrets.token_hex(4)}"
        limits = {"name": name, "episode": episode, "seat": seat, "once": once}
        with _reported():
            _check_once(role, once)
            tokens = Tokens(_keyring(keys), wall)
            token = _minted(tokens, role, whom, seconds, limits)
            grant = tokens.check_role(token)
        if as_json:
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
        """Say what a role token grants. Exit status 1 if the server would refuse it."""
        with _reported():
            grant = Tokens(_keyring(keys), wall).check_role(_given(token))
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
            int, typer.Option(min=1, max=MAX_KEYS, help="Keep so many keys, the new one included.")
        ] = KEPT_KEYS,
        keys: KeysOption = DEFAULT_KEYS,
        as_json: JsonOption = False,
    ) -> None:
        """Put a new key first. Servers that use the file take it at once; the file is made if
        there is none. Tokens of keys that fall off are refused from then on."""
        with _reported():
            before = {key.kid for key in load(keys)} if keys.exists() else set()
            new = rotate(keys, keep=keep)
            kept = [key.kid for key in load(keys)]
        dropped = sorted(before - set(kept))
        if as_json:
            print(json.dumps({"file": str(keys), "keys": kept, "dropped": dropped}))
            return
        tell(f"{keys}: {new.kid} signs from now on; {_listed(kept[1:])} still verify")
        if dropped:
            tell(f"tokens signed with {_listed(dropped)} are refused from now on")


def _add_revoke(app: typer.Typer, wall: Callable[[], float]) -> None:
    @app.command("revoke")
    def revoke_token(
        token: Annotated[
            str, typer.Argument(help="The token, or its id; - reads it from standard input.")
        ],
        keys: KeysOption = DEFAULT_KEYS,
        as_json: JsonOption = False,
    ) -> None:
        """Take a token back. Running servers refuse it within a second or two, and cut the
        connections of those who came in with it; they cannot resume either."""
        path = keys.with_name(REVOKED_FILE)
        with _reported():
            token_id, expires = _identified(_given(token), keys, wall)
            revoke(path, [token_id], expires, wall())
        if as_json:
            print(json.dumps({"file": str(path), "token_id": token_id}))
        else:
            tell(f"{path}: the token {token_id} is refused from now on")


def _check_once(role: Role, once: bool) -> None:
    if once and role.includes(Role.HOST):
        raise RobotouilleError(f"--once is for players and spectators, not for a {role}")


def _given(token: str) -> str:
    return sys.stdin.read().strip() if token == STDIN else token.strip()


def _identified(text: str, keys: Path, wall: Callable[[], float]) -> tuple[str, float]:
    """The id of a token, or what is one, and when the token ends, as far as that can be known."""
    if text.count(".") == 2:
        grant = Tokens(_keyring(keys), wall).check_role(text)
        return grant.token_id, grant.expires
    if not _TOKEN_ID.fullmatch(text):
        raise RobotouilleError("give a token or its id, as `robotouille-token show` prints it")
    _keyring(keys)
    return text, wall() + MAX_DAYS * 86400


def _minted(
    tokens: Tokens, role: Role, subject: str, seconds: float, limits: dict[str, Any]
) -> str:
    try:
        return tokens.mint_role(role, subject, seconds=seconds, **limits)
    except ValueError as error:
        raise RobotouilleError(f"no token can hold this: {error}") from None


def _keyring(path: Path) -> Keyring:
    """The keys of the environment, as for the server; else those of the file, which is not made:
    a key that the server does not have signs nothing of worth."""
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
    words += ["good for one session"] if grant.once else []
    return f"{', '.join(words)}, until {_time(grant.expires)}, id {grant.token_id}"


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "no others"


@contextmanager
def _reported() -> Iterator[None]:
    """Errors on purpose as one line and exit status 1."""
    try:
        yield
    except ProtocolError as error:
        tell(f"robotouille-token: {error.code}: {error.message}", err=True)
        raise typer.Exit(1) from None
    except RobotouilleError as error:
        tell(f"robotouille-token: {error}", err=True)
        raise typer.Exit(1) from None


def main() -> None:
    """The entry point of `robotouille-token`."""
    token_app()()


if __name__ == "__main__":
    main()
