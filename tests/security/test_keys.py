"""Signing keys: from a setting, from a file, and replaced while a server runs."""

from __future__ import annotations

import base64
import json
import os
import stat
import sys
import threading
from pathlib import Path

import pytest
from structlog.testing import capture_logs

from robotouille_server.auth.keys import FileKeyring, Key, KeyFileError, Keyring, load, rotate

posix_only = pytest.mark.skipif(sys.platform == "win32", reason="file modes")


def encoded(secret: bytes) -> str:
    return base64.urlsafe_b64encode(secret).decode().rstrip("=")


def key_file(path: Path, *keys: tuple[str, bytes], mode: int = 0o600) -> Path:
    entries = [{"kid": kid, "secret": encoded(secret)} for kid, secret in keys]
    path.write_text(json.dumps({"keys": entries}))
    path.chmod(mode)
    return path


ONE, TWO = bytes(range(32)), bytes(range(200, 240))


def test_the_first_key_of_a_setting_signs_and_all_are_found() -> None:
    ring = Keyring.parse(f"new:{encoded(TWO)}, old:{encoded(ONE)}=")
    assert ring.signing == Key("new", TWO)
    assert ring.find("old") == Key("old", ONE)
    assert ring.find("other") is None
    assert ring.find(None) is None


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "key 1 is not written as NAME:BASE64URL"),
        (f"{encoded(ONE)}", "key 1 is not written as NAME:BASE64URL"),
        (f"a:{encoded(ONE)},b", "key 2 is not written as NAME:BASE64URL"),
        ("a:!!!!", "key 1 is not base64url"),
        ("a:" + encoded(ONE[:31]), "key 1: its secret has 31 bytes; at least 32 are needed"),
        (f"a b:{encoded(ONE)}", "key 1: its name must be"),
        (f":{encoded(ONE)}", "key 1: its name must be"),
        (f"a:{encoded(ONE)},a:{encoded(TWO)}", "two keys have the same name"),
        (",".join(f"k{i}:{encoded(ONE)}" for i in range(17)), "17 keys; there must be 1 to 16"),
    ],
)
def test_a_wrong_setting_is_named_and_its_secret_is_not(text: str, fault: str) -> None:
    with pytest.raises(KeyFileError) as caught:
        Keyring.parse(text, "ROBOTOUILLE_SIGNING_KEYS")
    assert str(caught.value).startswith("ROBOTOUILLE_SIGNING_KEYS: ")
    assert fault in str(caught.value)
    assert encoded(ONE)[:12] not in str(caught.value)
    assert encoded(ONE) not in repr(Key("a", ONE))


@posix_only
def test_a_missing_file_is_made_for_its_owner_only(tmp_path: Path) -> None:
    old_mask = os.umask(0)
    try:
        ring = FileKeyring(tmp_path / "state" / "keys.json")
    finally:
        os.umask(old_mask)
    assert stat.S_IMODE(ring.path.stat().st_mode) == 0o600
    assert stat.S_IMODE(ring.path.parent.stat().st_mode) == 0o700
    assert len(ring.signing.secret) == 32
    assert [path.name for path in ring.path.parent.iterdir()] == ["keys.json"]


def test_a_second_start_finds_the_key_of_the_first(tmp_path: Path) -> None:
    path = tmp_path / "keys.json"
    assert FileKeyring(path).keys == FileKeyring(path).keys == load(path)


def test_processes_that_start_at_once_agree_on_one_key(tmp_path: Path) -> None:
    path = tmp_path / "state" / "keys.json"
    barrier = threading.Barrier(8)
    found: list[tuple[Key, ...]] = []

    def start() -> None:
        barrier.wait()
        found.append(FileKeyring(path).keys)

    threads = [threading.Thread(target=start) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [load(path)] * 8


def test_a_rotated_file_is_taken_at_once_and_old_keys_still_verify(tmp_path: Path) -> None:
    ring = FileKeyring(tmp_path / "keys.json")
    first = ring.signing
    second = rotate(ring.path)
    assert ring.signing == second != first
    assert ring.find(first.kid) == first


def test_rotation_keeps_only_so_many(tmp_path: Path) -> None:
    path = tmp_path / "keys.json"
    made = [rotate(path, keep=3) for _ in range(5)]
    assert load(path) == (made[4], made[3], made[2])
    newest = rotate(path, keep=1)
    assert load(path) == (newest,)
    with pytest.raises(KeyFileError, match="keep 1 to 16 keys, not 0"):
        rotate(path, keep=0)


@posix_only
def test_a_rotated_file_stays_private_and_where_a_link_points(tmp_path: Path) -> None:
    real = tmp_path / "real.json"
    rotate(real)
    link = tmp_path / "keys.json"
    link.symlink_to(real)
    key = rotate(link)
    assert link.is_symlink()
    assert load(real)[0] == key
    assert stat.S_IMODE(real.stat().st_mode) == 0o600


def test_a_broken_new_file_is_passed_over_until_it_is_whole(tmp_path: Path) -> None:
    path = key_file(tmp_path / "keys.json", ("a", ONE))
    ring = FileKeyring(path)
    with capture_logs() as logs:
        path.write_text('{"keys": [')
        assert [ring.signing for _ in range(3)] == [Key("a", ONE)] * 3
        path.unlink()
        assert [ring.signing for _ in range(3)] == [Key("a", ONE)] * 3
        key_file(path, ("b", TWO), ("a", ONE))
        assert [ring.signing for _ in range(3)] == [Key("b", TWO)] * 3
    errors = [line["error"] for line in logs if line["log_level"] == "error"]
    assert len(errors) == 2
    assert all(str(path) in error for error in errors)


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ("", "the file: Invalid JSON"),
        ("{}", "keys: Field required"),
        ('{"keys": []}', "0 keys"),
        ('{"keys": [{"kid": "a"}]}', "keys.0.secret: Field required"),
        ('{"keys": [{"kid": "a", "secret": "AAAA", "alg": "none"}]}', "keys.0.alg: Extra inputs"),
        ('{"keys": [{"kid": "a", "secret": "SECRETÄ"}]}', "keys.0.secret is not base64url"),
        ('{"keys": [{"kid": "a", "secret": "c2VjcmV0"}]}', "its secret has 6 bytes"),
        ("x" * 70_000, "larger than 65536 bytes"),
    ],
)
def test_a_wrong_file_is_named_with_its_fault(tmp_path: Path, content: str, fault: str) -> None:
    path = tmp_path / "keys.json"
    path.write_text(content, encoding="utf-8")
    path.chmod(0o600)
    with pytest.raises(KeyFileError) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert fault in str(caught.value)
    assert "c2VjcmV0" not in str(caught.value)


@posix_only
@pytest.mark.parametrize("mode", [0o604, 0o606, 0o620, 0o644, 0o666])
def test_a_file_that_others_can_use_is_refused(tmp_path: Path, mode: int) -> None:
    path = key_file(tmp_path / "keys.json", ("a", ONE), mode=mode)
    with pytest.raises(KeyFileError, match=f"mode {mode:04o}.*chmod 600"):
        FileKeyring(path)


@posix_only
def test_a_group_may_read_it(tmp_path: Path) -> None:
    """As secrets are mounted into containers and services."""
    path = key_file(tmp_path / "keys.json", ("a", ONE), mode=0o440)
    assert FileKeyring(path).signing == Key("a", ONE)


def test_a_missing_file_and_an_impossible_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(KeyFileError, match="there is no such file; `robotouille-token rotate"):
        load(tmp_path / "none.json")
    (tmp_path / "file").touch()
    with pytest.raises(KeyFileError, match="its folder cannot be made"):
        FileKeyring(tmp_path / "file" / "keys.json")
    (tmp_path / "folder.json").mkdir()
    with pytest.raises(KeyFileError, match=r"folder\.json: cannot be read"):
        FileKeyring(tmp_path / "folder.json")
