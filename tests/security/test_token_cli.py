"""Command `robotouille-token`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from robotouille_server.auth.keys import FileKeyring, load
from robotouille_server.auth.roles import Role
from robotouille_server.auth.token_cli import token_app
from robotouille_server.auth.tokens import RoleGrant, Tokens

NOW = 1_800_000_000.0


@pytest.fixture(autouse=True)
def no_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROBOTOUILLE_KEYS", raising=False)
    monkeypatch.delenv("ROBOTOUILLE_SIGNING_KEYS", raising=False)


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    return FileKeyring(tmp_path / "keys.json").path


def command(*words: str, now: float = NOW, text: str | None = None) -> Result:
    return CliRunner().invoke(token_app(lambda: now), list(words), input=text)


def granted(keys: Path, token: str, now: float = NOW) -> RoleGrant:
    return Tokens(FileKeyring(keys), lambda: now).check_role(token)


def test_unknown_role_is_explained(keys: Path) -> None:
    done = command("mint", "hots", "--keys", str(keys))
    assert done.exit_code == 2
    said = " ".join(done.stderr.replace("│", " ").split())
    assert "unknown value 'hots'; did you mean 'host'? (possible: operator, host, player" in said


def test_spectator_gets_a_link(keys: Path) -> None:
    page, code = "https://kitchen.example.org/watch", "QWERT-YUPAS"
    words = ("--link", page, "--episode", code, "--keys", str(keys))
    done = command("mint", "spectator", *words)
    assert done.exit_code == 0, done.output
    address, _, token = done.stdout.strip().partition("#")
    assert address == page
    grant = granted(keys, token)
    assert (grant.role, grant.seat) == (Role.SPECTATOR, "")
    assert command("mint", "host", *words).exit_code == 1


def test_minted_token_is_accepted(keys: Path) -> None:
    options = [
        "--subject",
        "p-017",
        "--episode",
        "QWERT-YUPAS",
        "--seat",
        "robot2",
        "--name",
        "Zoë",
    ]
    done = command("mint", "player", *options, "--hours", "2", "--keys", str(keys))
    assert done.exit_code == 0, done.output
    grant = Tokens(FileKeyring(keys), lambda: NOW).check_role(done.stdout.strip())
    assert (grant.role, grant.subject, grant.name) == (Role.PLAYER, "p-017", "Zoë")
    assert (grant.episode, grant.seat, grant.expires) == ("QWERT-YUPAS", "robot2", NOW + 7200)
    assert len(done.stdout.splitlines()) == 1
    assert "player p-017, named Zoë, only in the episode QWERT-YUPAS" in done.stderr


@pytest.mark.parametrize(
    ("words", "seconds"),
    [([], 86400), (["--days", "7"], 7 * 86400), (["--days", "1", "--hours", "12"], 36 * 3600)],
)
def test_validity_of_tokens(keys: Path, words: list[str], seconds: int) -> None:
    done = command("mint", "host", *words, "--keys", str(keys), "--json")
    answer = json.loads(done.stdout)
    assert Tokens(FileKeyring(keys), lambda: NOW).check_role(answer["token"]).expires == (
        NOW + seconds
    )
    assert answer["role"] == "host"


def test_show_prints_the_grant(keys: Path) -> None:
    token = command("mint", "host", "--subject", "ada", "--keys", str(keys)).stdout.strip()
    shown = command("show", token, "--keys", str(keys))
    token_id = granted(keys, token).token_id
    said = f"host ada, until 2027-01-16T08:00:00Z, id {token_id}.\n"
    assert (shown.exit_code, shown.stdout) == (0, said)
    piped = command("show", "-", "--keys", str(keys), "--json", text=f"{token}\n")
    answer = json.loads(piped.stdout)
    assert (answer["subject"], answer["expires"]) == ("ada", "2027-01-16T08:00:00Z")


def test_show_explains_refusals(keys: Path, tmp_path: Path) -> None:
    token = command("mint", "host", "--keys", str(keys)).stdout.strip()
    late = command("show", token, "--keys", str(keys), now=NOW + 86400)
    assert (late.exit_code, late.stdout) == (1, "")
    assert late.stderr.startswith("robotouille-token: auth/expired: ")
    other = FileKeyring(tmp_path / "other.json").path
    foreign = command("show", token, "--keys", str(other))
    assert foreign.exit_code == 1
    assert "auth/invalid" in foreign.stderr


def test_tokens_without_a_subject_get_different_ones(keys: Path) -> None:
    """Limits and bans apply per subject."""
    tokens = [command("mint", "player", "--keys", str(keys)).stdout.strip() for _ in range(2)]
    one, other = (granted(keys, token) for token in tokens)
    assert one.subject.startswith("p-")
    assert one.subject != other.subject
    assert one.token_id != other.token_id


def test_show_reports_revocation(keys: Path) -> None:
    token = command("mint", "host", "--keys", str(keys)).stdout.strip()
    other = command("mint", "host", "--keys", str(keys)).stdout.strip()
    done = command("revoke", "-", "--keys", str(keys), text=token)
    token_id = granted(keys, token).token_id
    revoked = keys.with_name("revoked.json")
    assert done.stdout == f"{revoked}: the token {token_id} is revoked\n"
    shown = command("show", token, "--keys", str(keys))
    assert (shown.exit_code, shown.stdout.endswith(": revoked.\n")) == (1, True)
    assert json.loads(command("show", token, "--keys", str(keys), "--json").stdout)["revoked"]
    assert command("show", other, "--keys", str(keys)).exit_code == 0
    done = command("revoke", granted(keys, other).token_id, "--keys", str(keys), "--json")
    assert json.loads(done.stdout)["token_id"] == granted(keys, other).token_id
    assert command("show", other, "--keys", str(keys)).exit_code == 1


def test_once_is_for_players_and_spectators(keys: Path) -> None:
    done = command("mint", "player", "--once", "--keys", str(keys))
    assert granted(keys, done.stdout.strip()).once
    assert "valid for one session" in done.stderr
    refused = command("mint", "host", "--once", "--keys", str(keys))
    assert (refused.exit_code, refused.stdout) == (1, "")
    assert "--once is for players" in refused.stderr


def test_rotate_reports_new_kept_and_dropped_keys(keys: Path) -> None:
    first = load(keys)[0].kid
    token = command("mint", "host", "--keys", str(keys)).stdout.strip()
    done = command("rotate", "--keys", str(keys), "--keep", "2")
    second = load(keys)[0].kid
    assert done.stdout == f"{keys}: new tokens are signed with {second}; {first} still valid\n"
    assert granted(keys, token)
    done = command("rotate", "--keys", str(keys), "--keep", "2", "--json")
    third = load(keys)[0].kid
    assert json.loads(done.stdout) == {
        "file": str(keys), "keys": [third, second], "dropped": [first],
    }  # fmt: skip
    assert command("show", token, "--keys", str(keys)).exit_code == 1


def test_rotate_creates_a_missing_file_and_mint_does_not(tmp_path: Path) -> None:
    path = tmp_path / "new.json"
    refused = command("mint", "host", "--keys", str(path))
    assert refused.exit_code == 1
    assert refused.stderr.startswith(f"robotouille-token: {path}: the file does not exist")
    assert not path.exists()
    assert command("rotate", "--keys", str(path)).exit_code == 0
    assert command("mint", "host", "--keys", str(path)).exit_code == 0


def test_keys_of_the_environment_take_precedence(
    keys: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROBOTOUILLE_SIGNING_KEYS", f"env:{'A' * 43}")
    token = command("mint", "host", "--keys", str(keys)).stdout.strip()
    assert command("show", token).exit_code == 0
    monkeypatch.delenv("ROBOTOUILLE_SIGNING_KEYS")
    monkeypatch.setenv("ROBOTOUILLE_KEYS", str(keys))
    assert command("show", token).exit_code == 1
    assert command("mint", "host").exit_code == 0


@pytest.mark.parametrize(
    ("words", "status"),
    [
        (["mint", "king"], 2),
        (["mint", "host", "--hours", "0"], 2),
        (["mint", "host", "--days", "1e9"], 2),
        (["mint", "host", "--subject", "x" * 65], 1),
        (["mint", "host", "--subject", ""], 1),
        (["rotate", "--keep", "0"], 2),
        (["show", "what"], 1),
        (["revoke", "a.b.c"], 1),
        (["revoke", "two words"], 1),
        (["revoke", ""], 1),
    ],
)
def test_errors_are_one_line(keys: Path, words: list[str], status: int) -> None:
    done = command(*words, "--keys", str(keys))
    assert done.exit_code == status
    assert done.stdout == ""
    assert done.stderr
    assert "Traceback" not in done.stderr
