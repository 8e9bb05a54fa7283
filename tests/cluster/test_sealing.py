"""Encryption of the signing keys that nodes share."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from structlog.testing import capture_logs

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille_server.auth.keys import FileKeyring, Key, encode_keys, load, rotate
from robotouille_server.cluster.keys.sealing import read_cluster_key
from robotouille_server.cluster.keys.secrets import KEYS
from tests.support.shared_bucket import CLUSTER_KEY, Node, Shared, errors

posix_only = pytest.mark.skipif(sys.platform == "win32", reason="file modes")
OTHER_KEY = bytes(32)


async def test_encrypted_keys_are_unreadable_in_the_bucket(shared: Shared, tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    one = Node(shared, tmp_path / "a", key=CLUSTER_KEY)
    two = Node(shared, tmp_path / "b", key=CLUSTER_KEY)
    for node in (one, two):
        await node.secrets.join()
    first = shared.entries[KEYS].value
    new = rotate(two.keys)
    await two.secrets.share_changes()
    assert load(one.keys)[0] == new
    for value in (first, shared.entries[KEYS].value):
        assert b"kid" not in value
        assert value[0] == 1
    assert first[9:21] != shared.entries[KEYS].value[9:21], "each value has its own nonce"


@pytest.mark.parametrize(
    ("stored", "given_key", "text"),
    [
        (CLUSTER_KEY, None, "are encrypted; start this node with --cluster-key"),
        (CLUSTER_KEY, OTHER_KEY, "another cluster uses this name .* or the file differs from the"),
        (None, CLUSTER_KEY, "are not encrypted. To change that, stop all nodes, delete the key"),
    ],
)
async def test_different_cluster_keys_prevent_the_start(
    shared: Shared, tmp_path: Path, stored: bytes | None, given_key: bytes | None, text: str
) -> None:
    pytest.importorskip("cryptography")
    await Node(shared, tmp_path / "a", key=stored).secrets.join()
    node = Node(shared, tmp_path / "b", key=given_key)
    own = FileKeyring(node.keys).keys
    with pytest.raises(RobotouilleError, match=text):
        await node.secrets.join()
    assert load(node.keys) == own


@pytest.mark.parametrize("change", [0, 5, 12, 40, -1, "short", "shorter", "other name"])
async def test_altered_keys_are_refused(
    shared: Shared, tmp_path: Path, change: int | str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("cryptography")
    await Node(shared, tmp_path / "a", key=CLUSTER_KEY).secrets.join()
    value = bytearray(shared.entries[KEYS].value)
    if isinstance(change, int):
        value[change] ^= 1
    elif change == "other name":
        monkeypatch.setattr("robotouille_server.cluster.keys.secrets.KEYS", "keys2")
        shared.change("keys2", bytes(value))
    else:
        del value[30 if change == "short" else 12 :]
    shared.change(KEYS, bytes(value))
    with pytest.raises(RobotouilleError, match=r"altered in NATS|does not fit|unknown format"):
        await Node(shared, tmp_path / "b", key=CLUSTER_KEY).secrets.join()


async def test_running_node_accepts_encrypted_keys_only(shared: Shared, tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    node = Node(shared, tmp_path / "a", key=CLUSTER_KEY)
    await node.secrets.join()
    keys = load(node.keys)
    with capture_logs() as logs:
        shared.change(KEYS, encode_keys([Key("attacker", b"x" * 32)]))
    assert "not encrypted" in errors(logs)[0]
    assert load(node.keys) == keys


def test_encryption_needs_its_library(
    shared: Shared, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "cryptography.exceptions", None)
    with pytest.raises(MissingExtraError, match=r"robotouille\[cluster\]"):
        Node(shared, tmp_path, key=CLUSTER_KEY)
    Node(shared, tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        CLUSTER_KEY.hex(),
        CLUSTER_KEY.hex().upper() + "\n",
        "AAECAwQFBgcICQoLDA0ODxAREhMUFRYXGBkaGxwdHh8",
        "AAECAwQFBgcICQoLDA0ODxAREhMUFRYXGBkaGxwdHh8=\n",
    ],
)
def test_cluster_key_is_hexadecimal_or_base64url(tmp_path: Path, text: str) -> None:
    path = tmp_path / "cluster.key"
    path.write_text(text)
    path.chmod(0o600)
    assert read_cluster_key(path) == CLUSTER_KEY


@pytest.mark.parametrize(
    ("content", "mode", "fault"),
    [
        (None, 0, r"the file does not exist; make one with .*openssl rand -hex 32"),
        (b"", 0o600, "expected 32 bytes as 64 hex digits or in base64url; make one with"),
        (b"secret", 0o600, "expected 32 bytes"),
        (b"0" * 62, 0o600, "expected 32 bytes"),
        (b"\xff" * 32, 0o600, "expected 32 bytes"),
        (b"0" * 64, 0o644, "other users may access it .* run `chmod 600"),
        (b"0" * 5000, 0o600, "larger than 4096 bytes"),
    ],
)
@posix_only
def test_invalid_cluster_key_is_reported(
    tmp_path: Path, content: bytes | None, mode: int, fault: str
) -> None:
    path = tmp_path / "cluster.key"
    if content is not None:
        path.write_bytes(content)
        path.chmod(mode)
    with pytest.raises(RobotouilleError, match=fault) as caught:
        read_cluster_key(path)
    assert str(caught.value).startswith(f"--cluster-key: {path}: ")
    assert "secret" not in str(caught.value)
