"""`robotouille-token`, as an operator uses it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from robotouille_server.keys import FileKeyring, load
from robotouille_server.roles import Role
from robotouille_server.token_cli import token_app
from robotouille_server.tokens import Tokens

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


def granted(keys: Path, token: str, now: float = NOW) -> object:
    return Tokens(FileKeyring(keys), lambda: now).check_role(token)


def test_a_minted_token_is_one_line_that_the_server_takes(keys: Path) -> None:
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
def test_tokens_last_as_long_as_is_said(keys: Path, words: list[str], seconds: int) -> None:
    done = command("mint", "host", *words, "--keys", str(keys), "--json")
    answer = json.loads(done.stdout)
    assert Tokens(FileKeyring(keys), lambda: NOW).check_role(answer["token"]).expires == (
        NOW + seconds
    )
    assert answer["role"] == "host"


def test_show_says_what_a_token_grants(keys: Path) -> None:
    token = command("mint", "host", "--subject", "ada", "--keys", str(keys)).stdout.strip()
    shown = command("show", token, "--keys", str(keys))
    assert (shown.exit_code, shown.stdout) == (0, "host ada, until 2027-01-16T08:00:00Z.\n")
    piped = command("show", "-", "--keys", str(keys), "--json", text=f"{token}\n")
    answer = json.loads(piped.stdout)
    assert (answer["subject"], answer["expires"]) == ("ada", "2027-01-16T08:00:00Z")


def test_show_says_why_the_server_would_refuse_it(keys: Path, tmp_path: Path) -> None:
    token = command("mint", "host", "--keys", str(keys)).stdout.strip()
    late = command("show", token, "--keys", str(keys), now=NOW + 86400)
    assert (late.exit_code, late.stdout) == (1, "")
    assert late.stderr.startswith("robotouille-token: auth/expired: ")
    other = FileKeyring(tmp_path / "other.json").path
    foreign = command("show", token, "--keys", str(other))
    assert foreign.exit_code == 1
    assert "auth/invalid" in foreign.stderr


def test_rotation_says_what_signs_what_verifies_and_what_is_over(keys: Path) -> None:
    first = load(keys)[0].kid
    token = command("mint", "host", "--keys", str(keys)).stdout.strip()
    done = command("rotate", "--keys", str(keys), "--keep", "2")
    second = load(keys)[0].kid
    assert done.stdout == f"{keys}: {second} signs from now on; {first} still verify\n"
    assert granted(keys, token)
    done = command("rotate", "--keys", str(keys), "--keep", "2", "--json")
    third = load(keys)[0].kid
    assert json.loads(done.stdout) == {
        "file": str(keys), "keys": [third, second], "dropped": [first],
    }  # fmt: skip
    assert command("show", token, "--keys", str(keys)).exit_code == 1


def test_rotation_makes_a_missing_file_and_mint_does_not(tmp_path: Path) -> None:
    path = tmp_path / "new.json"
    refused = command("mint", "host", "--keys", str(path))
    assert refused.exit_code == 1
    assert refused.stderr.startswith(f"robotouille-token: {path}: there is no such file")
    assert not path.exists()
    assert command("rotate", "--keys", str(path)).exit_code == 0
    assert command("mint", "host", "--keys", str(path)).exit_code == 0


def test_the_keys_of_the_environment_win(keys: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    ],
)
def test_mistakes_are_reported_in_a_line(keys: Path, words: list[str], status: int) -> None:
    done = command(*words, "--keys", str(keys))
    assert done.exit_code == status
    assert done.stdout == ""
    assert done.stderr
    assert "Traceback" not in done.stderr
