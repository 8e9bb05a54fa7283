"""Signing keys from a setting or a file, and their rotation."""

from __future__ import annotations

import base64
import json
import os
import stat
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from structlog.testing import capture_logs

from robotouille_server.auth.keys import (
    FileKeyring,
    Key,
    KeyFileError,
    Keyring,
    load,
    replace_keys,
    rotate,
)

posix_only = pytest.mark.skipif(sys.platform == "win32", reason="file modes")


def encoded(secret: bytes) -> str:
    return base64.urlsafe_b64encode(secret).decode().rstrip("=")


def key_file(path: Path, *keys: tuple[str, bytes], mode: int = 0o600) -> Path:
    entries = [{"kid": kid, "secret": encoded(secret)} for kid, secret in keys]
    path.write_text(json.dumps({"keys": entries}))
    path.chmod(mode)
    return path


ONE, TWO = bytes(range(32)), bytes(range(200, 240))


def test_first_key_of_a_setting_signs() -> None:
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
        ("a:" + encoded(ONE[:31]), "key 1: the secret has 31 bytes; at least 32 are required"),
        (f"a b:{encoded(ONE)}", "key 1: the name must have"),
        (f":{encoded(ONE)}", "key 1: the name must have"),
        (f"a:{encoded(ONE)},a:{encoded(TWO)}", "two keys have the same name"),
        (",".join(f"k{i}:{encoded(ONE)}" for i in range(17)), "17 keys; 1 to 16 are allowed"),
    ],
)
def test_error_about_a_setting_hides_the_secret(text: str, fault: str) -> None:
    with pytest.raises(KeyFileError) as caught:
        Keyring.parse(text, "ROBOTOUILLE_SIGNING_KEYS")
    assert str(caught.value).startswith("ROBOTOUILLE_SIGNING_KEYS: ")
    assert fault in str(caught.value)
    assert encoded(ONE)[:12] not in str(caught.value)
    assert encoded(ONE) not in repr(Key("a", ONE))


@posix_only
def test_missing_file_is_created_privately(tmp_path: Path) -> None:
    old_mask = os.umask(0)
    try:
        ring = FileKeyring(tmp_path / "state" / "keys.json")
    finally:
        os.umask(old_mask)
    assert stat.S_IMODE(ring.path.stat().st_mode) == 0o600
    assert stat.S_IMODE(ring.path.parent.stat().st_mode) == 0o700
    assert len(ring.signing.secret) == 32
    assert [path.name for path in ring.path.parent.iterdir()] == ["keys.json"]


def test_second_start_uses_the_same_key(tmp_path: Path) -> None:
    path = tmp_path / "keys.json"
    assert FileKeyring(path).keys == FileKeyring(path).keys == load(path)


def test_concurrent_starts_agree_on_one_key(tmp_path: Path) -> None:
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


def test_rotated_file_is_used_at_once(tmp_path: Path) -> None:
    ring = FileKeyring(tmp_path / "keys.json")
    first = ring.signing
    second = rotate(ring.path)
    assert ring.signing == second != first
    assert ring.find(first.kid) == first


def test_rotation_limits_the_number_of_keys(tmp_path: Path) -> None:
    path = tmp_path / "keys.json"
    made = [rotate(path, keep=3) for _ in range(5)]
    assert load(path) == (made[4], made[3], made[2])
    newest = rotate(path, keep=1)
    assert load(path) == (newest,)
    with pytest.raises(KeyFileError, match="must be 1 to 16, not 0"):
        rotate(path, keep=0)


@posix_only
def test_concurrent_rotations_are_all_kept(tmp_path: Path) -> None:
    path = tmp_path / "keys.json"
    old = rotate(path)
    with ThreadPoolExecutor(4) as pool:
        made = list(pool.map(lambda _: rotate(path, keep=16), range(12)))
    assert set(load(path)) == {old, *made}


def test_keys_are_replaced_unless_the_file_has_changed(tmp_path: Path) -> None:
    path = tmp_path / "keys.json"
    one, two, three = (Key("a", ONE),), (Key("b", TWO),), (Key("c", TWO),)
    assert replace_keys(path, one, two), "a missing file is created"
    assert not replace_keys(path, two, three)
    assert load(path) == one
    assert replace_keys(path, two, one)
    assert replace_keys(path, two, three), "it has the new keys already"
    path.write_text("{")
    assert replace_keys(path, three, one)
    assert load(path) == three


@posix_only
def test_rotated_file_stays_private_and_follows_links(tmp_path: Path) -> None:
    real = tmp_path / "real.json"
    rotate(real)
    link = tmp_path / "keys.json"
    link.symlink_to(real)
    key = rotate(link)
    assert link.is_symlink()
    assert load(real)[0] == key
    assert stat.S_IMODE(real.stat().st_mode) == 0o600


def test_invalid_file_is_ignored_until_it_is_valid(tmp_path: Path) -> None:
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
        ('{"keys": [{"kid": "a", "secret": "c2VjcmV0"}]}', "the secret has 6 bytes"),
        ("x" * 70_000, "larger than 65536 bytes"),
    ],
)
def test_invalid_file_is_reported(tmp_path: Path, content: str, fault: str) -> None:
    path = tmp_path / "keys.json"
    path.write_text(content, encoding="utf-8")
    path.chmod(0o600)
    with pytest.raises(KeyFileError) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert fault in str(caught.value)
    assert "c2VjcmV0" not in str(caught.value)


@posix_only
def test_group_readable_file_is_accepted(tmp_path: Path) -> None:
    """Secrets are mounted into containers and services like this."""
    path = key_file(tmp_path / "keys.json", ("a", ONE), mode=0o440)
    assert FileKeyring(path).signing == Key("a", ONE)


def test_missing_file_and_folder_are_reported(tmp_path: Path) -> None:
    with pytest.raises(KeyFileError, match="the file does not exist; `robotouille-token rotate"):
        load(tmp_path / "none.json")
    (tmp_path / "file").touch()
    with pytest.raises(KeyFileError, match="its folder cannot be created"):
        FileKeyring(tmp_path / "file" / "keys.json")
    (tmp_path / "folder.json").mkdir()
    with pytest.raises(KeyFileError, match=r"folder\.json: cannot be read"):
        FileKeyring(tmp_path / "folder.json")
