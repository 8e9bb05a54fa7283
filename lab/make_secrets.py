"""Make the passwords, folders and .env file that the lab of `docker-compose.yml` needs.

`python lab/make_secrets.py` needs only Python. It never changes an existing file. Run it again to
make missing files and to check the others.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import os
import secrets
import stat
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PASSWORDS = (
    "mqtt_server",
    "mqtt_lab",
    "mqtt_health",
    "nats_server",
    "nats_route",
    "postgres",
    "postgres_owner",
    "postgres_reader",
    "grafana_admin",
)
NATS = ("nats1", "nats2", "nats3")
FOLDERS = (
    "recordings", "recordings.state", "mosquitto", "postgres", "prometheus", "grafana", "caddy",
    "recordings2", "recordings2.state", "recordings3", "recordings3.state", *NATS,
)  # fmt: skip
ITERATIONS = 1000
"""Iterations of PBKDF2 with SHA-512. The broker computes them in its only thread for each
connection. Few are enough, because passwords of 192 random bits cannot be guessed."""


class LabError(Exception):
    """Unusable existing file. The message names the file, the fault and a remedy."""


def mosquitto_line(user: str, password: str) -> str:
    """Return a user's line for Mosquitto's password file; `$7$` is PBKDF2 with SHA-512."""
    salt = secrets.token_bytes(12)
    key = hashlib.pbkdf2_hmac("sha512", password.encode(), salt, ITERATIONS)
    encoded = (base64.b64encode(part).decode() for part in (salt, key))
    return f"{user}:$7${ITERATIONS}${'$'.join(encoded)}\n"


def _mosquitto_lines(known: Mapping[str, str]) -> str:
    return "".join(
        mosquitto_line(user, known[f"mqtt_{user}"]) for user in ("server", "lab", "health")
    )


def _options(user: str, known: Mapping[str, str]) -> str:
    """Return an options file for `mosquitto_sub` and `mosquitto_pub`.

    It keeps the password off the command line.
    """
    return f"-u {user}\n-P {known[f'mqtt_{user}']}\n"


def _nats_variables(known: Mapping[str, str]) -> str:
    """Return the variables of `nats.conf`, which cannot put a password into an address itself."""
    route = known["nats_route"]
    routes = ", ".join(f'"nats://route:{route}@{name}:6222"' for name in NATS)
    lines = (
        f'SERVER_PASSWORD: "{known["nats_server"]}"',
        f'ROUTE_PASSWORD: "{route}"',
        f"ROUTES: [{routes}]",
    )
    return "".join(f"{line}\n" for line in lines)


DERIVED: Mapping[str, tuple[tuple[str, ...], Callable[[Mapping[str, str]], str]]] = {
    "mqtt_passwords": (("mqtt_server", "mqtt_lab", "mqtt_health"), _mosquitto_lines),
    "mosquitto_lab": (("mqtt_lab",), lambda known: _options("lab", known)),
    "mosquitto_health": (("mqtt_health",), lambda known: _options("health", known)),
    "nats_variables": (("nats_server", "nats_route"), _nats_variables),
    "cluster_key": ((), lambda known: secrets.token_hex(32)),
    "pgpass": (
        ("postgres_owner", "postgres_reader"),
        lambda known: (
            f"postgres:5432:robotouille:robotouille:{known['postgres_owner']}\n"
            f"postgres:5432:robotouille:reader:{known['postgres_reader']}\n"
        ),
    ),
}
"""Other files, with the names of the passwords in them and a function for the content."""


def make(root: Path, user: str) -> Iterator[str]:
    """Make missing files below a repository and yield their names.

    Args:
        root: Root of the repository.
        user: `UID:GID` that the containers run as.

    Raises:
        LabError: A file is empty, is readable by others, or was made from a missing password.
    """
    folder = root / "lab/secrets"
    owner = tuple(map(int, user.split(":")))
    _make_folder(folder, owner)
    for name in FOLDERS:
        _make_folder(root / "lab/data" / name, owner)
    for name, (sources, _) in DERIVED.items():
        lost = [source for source in sources if not (folder / source).exists()]
        if (folder / name).exists() and lost:
            raise LabError(
                f"{folder / name} was made from {lost[0]}, which is missing; delete it, too"
            )
    for name in PASSWORDS:
        if _write(folder / name, secrets.token_hex(24), owner):
            yield f"lab/secrets/{name}"
    known = {name: _read(folder / name) for name in PASSWORDS}
    for name, (_, content) in DERIVED.items():
        if (folder / name).exists():
            _read(folder / name)
        elif _write(folder / name, content(known), owner):
            yield f"lab/secrets/{name}"
    if _write(root / ".env", _environment(user), owner):
        yield ".env"


def _environment(user: str) -> str:
    """Return the .env file with which `docker compose up` starts the lab."""
    return (
        "COMPOSE_PROFILES=lab\n"
        f"LAB_USER={user}\n"
        "LAB_HOST=localhost\n"
        "LAB_TLS=\n"
        "LAB_SECRETS=./lab/secrets\n"
        "LAB_RECORDINGS=./lab/data/recordings\n"
        "LAB_STATE=./lab/data/recordings.state\n"
        "LAB_MQTT=mqtt://server@mosquitto\n"
        "LAB_CLUSTER=\n"
    )


def _make_folder(path: Path, owner: tuple[int, ...]) -> None:
    if path.is_dir():
        return
    path.mkdir(mode=0o700, parents=True)
    _give(path, owner)


def _write(path: Path, content: str, owner: tuple[int, ...]) -> bool:
    """Make a file that only its owner can read; return False if it exists."""
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        return False
    with os.fdopen(descriptor, "w", encoding="ascii") as file:
        file.write(content)
    _give(path, owner)
    return True


def _give(path: Path, owner: tuple[int, ...]) -> None:
    if os.geteuid() == 0:
        os.chown(path, *owner)


def _read(path: Path) -> str:
    mode = stat.S_IMODE(path.stat().st_mode)
    if mode & 0o077:
        raise LabError(f"{path} is open to others (mode {mode:04o}); run `chmod 600 {path}`")
    content = path.read_text(encoding="ascii").strip()
    if not content:
        raise LabError(f"{path} is empty; delete it and run this script again")
    return content


def _user(text: str) -> str:
    """Check a `UID:GID`, neither of them root's."""
    parts = text.split(":")
    if len(parts) != 2 or not all(part.isdecimal() and int(part) for part in parts):
        raise argparse.ArgumentTypeError("expected UID:GID, not root's: PostgreSQL refuses root")
    return text


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Make the lab's passwords, folders and .env.")
    parser.add_argument(
        "--user", type=_user, help="UID:GID that the containers run as; default: yours"
    )
    given = parser.parse_args().user
    if given is None and os.geteuid() == 0:
        parser.error("the containers cannot run as root; set their user with --user UID:GID")
    try:
        made = list(make(ROOT, given or f"{os.geteuid()}:{os.getegid()}"))
    except LabError as error:
        sys.exit(str(error))
    print("\n".join(f"made {name}" for name in made) or "nothing to make: all files exist")


if __name__ == "__main__":
    main()
