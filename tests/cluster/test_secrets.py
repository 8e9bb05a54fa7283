"""Signing keys that nodes share, and all secrets together."""

from __future__ import annotations

import asyncio
import random
import stat
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from structlog.testing import capture_logs

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille_server.auth import keys as key_files
from robotouille_server.auth import revocation
from robotouille_server.auth.keys import FileKeyring, Key, KeyFileError, encode_keys, load, rotate
from robotouille_server.auth.revocation import (
    USED_KEPT_SECONDS,
    Revocations,
    load_revoked,
    revoke,
)
from robotouille_server.cluster.bus import UnavailableError
from robotouille_server.cluster.keys.secrets import (
    KEYS,
    MAX_VALUE_BYTES,
    REVOKED,
    SharedSecrets,
    keys_digest,
    merged_keys,
)
from robotouille_server.runtime.logs import configure_logs
from tests.support.nats import missing, nats_cluster
from tests.support.samples import quick_sample
from tests.support.shared_bucket import CLUSTER_KEY, NOW, Node, Shared, errors

posix_only = pytest.mark.skipif(sys.platform == "win32", reason="file modes")


# Signing keys


@posix_only
async def test_second_node_gets_the_keys_of_the_first(shared: Shared, tmp_path: Path) -> None:
    one, two = Node(shared, tmp_path / "a"), Node(shared, tmp_path / "b")
    await one.secrets.join()
    await two.secrets.join()
    assert load(two.keys) == load(one.keys)
    assert stat.S_IMODE(two.keys.stat().st_mode) == 0o600
    assert stat.S_IMODE(two.keys.parent.stat().st_mode) == 0o700
    assert one.secrets.digest() == two.secrets.digest() == keys_digest(load(one.keys))


async def test_existing_keys_of_the_first_node_stay(shared: Shared, tmp_path: Path) -> None:
    node = Node(shared, tmp_path)
    own = FileKeyring(node.keys).keys
    before = node.keys.stat()
    await node.secrets.join()
    await Node(shared, tmp_path).secrets.join()
    assert load(node.keys) == own
    assert node.keys.stat().st_ino == before.st_ino, "equal files are not replaced"


async def test_nodes_that_start_at_the_same_time_agree(shared: Shared, tmp_path: Path) -> None:
    nodes = [Node(shared, tmp_path / str(n)) for n in range(5)]
    await asyncio.gather(*(node.secrets.join() for node in nodes))
    assert {load(node.keys) for node in nodes} == {load(nodes[0].keys)}


async def test_replaced_keys_are_logged(shared: Shared, tmp_path: Path) -> None:
    await Node(shared, tmp_path / "a").secrets.join()
    node = Node(shared, tmp_path / "b")
    lost = FileKeyring(node.keys).signing
    configure_logs("warning", "console")
    try:
        with capture_logs() as logs:
            await node.secrets.join()
    finally:
        configure_logs("error", "console")
    (line,) = [line for line in logs if line["log_level"] == "warning"]
    assert line["replaced"] == [lost.kid]


async def test_unusable_key_file_prevents_the_start(shared: Shared, tmp_path: Path) -> None:
    await Node(shared, tmp_path / "a").secrets.join()
    node = Node(shared, tmp_path / "b")
    rotate(tmp_path / "keys.json")
    node.keys.parent.mkdir(parents=True)
    node.keys.write_text("{}")
    node.keys.chmod(0o600)
    with pytest.raises(KeyFileError, match="keys: Field required"):
        await node.secrets.join()


async def test_keys_of_the_operator_are_not_shared(shared: Shared, tmp_path: Path) -> None:
    node = Node(shared, tmp_path, own_keys=True)
    await node.secrets.join()
    node.revoke("a")
    await node.secrets.share_changes()
    assert set(shared.entries) == {REVOKED}
    assert not node.keys.exists()
    assert node.secrets.digest() == ""


async def test_rotation_reaches_other_nodes(pair: tuple[Node, Node]) -> None:
    one, two = pair
    ring = FileKeyring(two.keys)
    digest = two.secrets.digest()
    new = rotate(one.keys)
    await one.secrets.share_changes()
    assert ring.signing == new
    assert load(one.keys) == load(two.keys)
    assert two.secrets.digest() == one.secrets.digest() != digest
    newest = rotate(two.keys, keep=1)
    await two.secrets.share_changes()
    assert load(one.keys) == (newest,)


async def test_simultaneous_rotations_are_both_kept(
    pair: tuple[Node, Node], shared: Shared
) -> None:
    one, two = pair
    old = load(one.keys)
    a, b = rotate(one.keys), rotate(two.keys)
    await asyncio.gather(one.secrets.share_changes(), two.secrets.share_changes())
    for _ in range(2):
        await one.secrets.share_changes()
        await two.secrets.share_changes()
    assert load(one.keys) == load(two.keys)
    assert set(load(one.keys)) == {a, b, *old}


async def test_dropped_key_does_not_come_back(pair: tuple[Node, Node]) -> None:
    one, two = pair
    (old,) = load(one.keys)
    a = rotate(one.keys)
    b = rotate(two.keys, keep=1)
    await one.secrets.share_changes()
    await two.secrets.share_changes()
    await one.secrets.share_changes()
    assert load(one.keys) == load(two.keys) == (b, a)
    assert old not in load(one.keys)


async def test_rotation_on_a_node_that_is_behind(pair: tuple[Node, Node]) -> None:
    one, two = pair
    two.link.deaf = True
    a = rotate(one.keys)
    await one.secrets.share_changes()
    b = rotate(two.keys)
    await two.secrets.share_changes()
    two.link.deaf = False
    two.link.deliver()
    assert load(two.keys) == load(one.keys)
    assert load(one.keys)[:2] == (b, a)


async def test_rotation_without_an_answer_is_shared_once(
    pair: tuple[Node, Node], shared: Shared
) -> None:
    one, two = pair
    one.link.answers, one.link.deaf = False, True
    new = rotate(one.keys)
    with pytest.raises(UnavailableError):
        await one.secrets.share_changes()
    one.link.answers, one.link.deaf = True, False
    revision = shared.revision
    await one.secrets.share_changes()
    await two.secrets.share_changes()
    assert shared.revision == revision
    assert load(one.keys) == load(two.keys)
    assert load(one.keys)[0] == new


async def test_rotation_is_shared_when_the_cluster_can_be_reached(
    pair: tuple[Node, Node],
) -> None:
    one, two = pair
    one.link.up = False
    new = rotate(one.keys)
    for _ in range(2):
        with pytest.raises(UnavailableError):
            await one.secrets.share_changes()
    assert load(one.keys)[0] == new
    one.link.up = True
    await one.secrets.share_changes()
    assert load(two.keys)[0] == new


async def test_more_keys_than_usual_stay_valid(pair: tuple[Node, Node]) -> None:
    one, two = pair
    for _ in range(4):
        rotate(one.keys, keep=5)
    await one.secrets.share_changes()
    assert len(load(two.keys)) == 5
    rotate(two.keys, keep=4)
    await two.secrets.share_changes()
    assert len(load(one.keys)) == 4


async def test_deleted_value_is_stored_again(pair: tuple[Node, Node], shared: Shared) -> None:
    one, two = pair
    one.revoke("a")
    await one.secrets.share_changes()
    keys = load(one.keys)
    for name in (KEYS, REVOKED):
        shared.change(name, None)
    await asyncio.gather(two.secrets.share_changes(), one.secrets.share_changes())
    assert set(shared.entries) == {KEYS, REVOKED}
    assert load(one.keys) == load(two.keys) == keys


async def test_deleted_bucket_is_filled_again(pair: tuple[Node, Node], shared: Shared) -> None:
    one, two = pair
    one.revoke("a")
    await one.secrets.share_changes()
    await one.secrets.use("t", "ada", NOW + 60)
    before = set(shared.entries)
    shared.delete()
    await asyncio.gather(two.secrets.restore(), one.secrets.restore())
    assert set(shared.entries) == before
    rotate(one.keys)
    two.revoke("b")
    await asyncio.gather(two.secrets.share_changes(), one.secrets.share_changes())
    assert load(one.keys) == load(two.keys)
    assert set(load_revoked(one.revoked)) == {"a", "b"}


async def test_restoring_an_intact_bucket_changes_nothing(
    pair: tuple[Node, Node], shared: Shared
) -> None:
    one, _ = pair
    one.revoke("a")
    await one.secrets.share_changes()
    await one.secrets.use("t", "ada", NOW + 60)
    revision = shared.revision
    await one.secrets.restore()
    assert shared.revision == revision


async def test_removed_files_are_written_again(pair: tuple[Node, Node]) -> None:
    one, two = pair
    one.revoke("a")
    await one.secrets.share_changes()
    keys = load(one.keys)
    two.keys.unlink()
    two.revoked.unlink()
    await two.secrets.share_changes()
    assert load(two.keys) == keys
    assert set(load_revoked(two.revoked)) == {"a"}


async def test_invalid_file_is_not_shared(pair: tuple[Node, Node], shared: Shared) -> None:
    one, two = pair
    revision = shared.revision
    for file in (one.keys, one.revoked):
        file.write_text('{"keys": [')
        file.chmod(0o600)
    with capture_logs() as logs:
        for _ in range(3):
            await one.secrets.share_changes()
    assert len(errors(logs)) == 2
    assert shared.revision == revision
    assert one.keys.read_text() == '{"keys": ['
    new = rotate(two.keys)
    two.revoke("b")
    await two.secrets.share_changes()
    assert load(one.keys)[0] == new
    one.revoked.write_text('{"revoked": []}')
    await one.secrets.share_changes()
    assert set(load_revoked(one.revoked)) == {"b"}


async def test_nothing_is_read_or_sent_without_changes(
    pair: tuple[Node, Node], shared: Shared, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read(*_: object) -> bytes:
        raise AssertionError

    one, two = pair
    rotate(one.keys)
    one.revoke("a")
    for node in (one, two) * 2:
        await node.secrets.share_changes()
    requests = shared.requests
    monkeypatch.setattr(key_files, "read_private", read)
    monkeypatch.setattr(revocation, "read_private", read)
    for node in pair:
        await node.secrets.share_changes()
    assert shared.requests == requests


SHARED_KEYS = [
    b"",
    b"[]",
    b'{"keys": []}',
    b'{"keys": [{"kid": "a", "secret": "AAAA"}]}',
    b"{" + b" " * MAX_VALUE_BYTES,
]


@pytest.mark.parametrize("value", SHARED_KEYS)
async def test_invalid_keys_of_the_cluster_are_ignored(
    pair: tuple[Node, Node], shared: Shared, tmp_path: Path, value: bytes
) -> None:
    one, two = pair
    keys = load(one.keys)
    with capture_logs() as logs:
        shared.change(KEYS, value)
        for node in (one, two) * 2:
            await node.secrets.share_changes()
        rotate(one.keys)
        await one.secrets.share_changes()
    assert len(errors(logs)) == 2, "one for each node"
    assert shared.entries[KEYS].value == value, "the nodes do not fight"
    assert load(two.keys) == keys
    with pytest.raises(RobotouilleError, match="the cluster's"):
        await Node(shared, tmp_path / "c").secrets.join()
    shared.change(KEYS, encode_keys(keys))
    await one.secrets.share_changes()
    assert load(one.keys) == load(two.keys)
    assert len(load(two.keys)) == 2, "the rotation in between is shared, too"


def test_digest_depends_on_names_and_secrets_only() -> None:
    one, two, same_name = Key("a", b"1" * 32), Key("b", b"2" * 32), Key("a", b"2" * 32)
    digests = {keys_digest(keys) for keys in ([one], [two], [same_name], [one, two])}
    assert len(digests) == 4
    assert keys_digest([one, two]) == keys_digest([two, one])
    assert all(len(digest) == 16 for digest in digests)


_KEYS = st.lists(
    st.builds(Key, st.sampled_from("abcdefgh"), st.sampled_from([b"1" * 32, b"2" * 32])),
    min_size=1,
    max_size=6,
    unique_by=lambda key: key.kid,
).map(tuple)


@given(_KEYS, _KEYS, _KEYS)
def test_merged_keys_are_valid(
    own: tuple[Key, ...], base: tuple[Key, ...], shared: tuple[Key, ...]
) -> None:
    merged = merged_keys(own, base, shared)
    key_files.Keyring(merged)
    assert merged_keys(own, base, base) == own
    assert merged_keys(base, base, shared) == shared
    new = [key for key in own if key not in base]
    assert set(new) <= set(merged) | set(shared)
    dropped = {key.kid for key in base} - {key.kid for key in own}
    assert merged == own or not dropped & {key.kid for key in merged}
    if len({*own, *base, *shared}) <= key_files.KEPT_KEYS:
        assert merged_keys(own, base, merged) == merged, "a second merge changes nothing"


# All together


@pytest.mark.parametrize("seed", quick_sample(range(20), 6))
async def test_nodes_agree_after_failures(shared: Shared, tmp_path: Path, seed: int) -> None:
    """Nodes rotate keys and revoke tokens while answers and changes are lost or late."""
    chance = random.Random(seed)
    nodes = [Node(shared, tmp_path / str(n)) for n in range(3)]
    for node in nodes:
        await node.secrets.join()
    revoked: set[str] = set()
    for step in range(40):
        node = chance.choice(nodes)
        act = chance.randrange(6)
        if act == 0:
            rotate(node.keys)
        elif act == 1:
            revoked.add(f"t-{step}")
            node.revoke(f"t-{step}")
        elif act == 2:
            node.link.up = chance.random() < 0.7
            node.link.answers = chance.random() < 0.7
            node.link.deaf = chance.random() < 0.3
            node.link.deliver()
        else:
            tasks = [each.secrets.share_changes() for each in nodes if chance.random() < 0.8]
            await asyncio.gather(*tasks, return_exceptions=True)
    for node in nodes:
        node.link.up, node.link.answers, node.link.deaf = True, True, False
        node.link.deliver()
    for node in nodes * 2:
        await node.secrets.share_changes()
    newest = rotate(nodes[0].keys)
    await nodes[0].secrets.share_changes()
    assert {load(node.keys) for node in nodes} == {load(nodes[0].keys)}
    assert load(nodes[1].keys)[0] == newest
    assert {frozenset(load_revoked(node.revoked)) for node in nodes} == {frozenset(revoked)}


# With NATS


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.skipif(bool(missing()), reason=missing())
async def test_secrets_are_shared_through_nats(tmp_path: Path) -> None:
    from robotouille_server.cluster.nats.nats_bus import NatsAddress, nats_bus

    pytest.importorskip("cryptography")
    with nats_cluster(tmp_path / "nats", servers=1) as cluster:
        address = NatsAddress(tuple(cluster.urls), "test")
        async with nats_bus(address) as bus, nats_bus(address) as other, asyncio.timeout(60):
            folders = [tmp_path / "a", tmp_path / "b"]
            nodes = [
                SharedSecrets(each, folder / "k.json", folder / "r.json", CLUSTER_KEY, lambda: NOW)
                for each, folder in zip((bus, other), folders, strict=True)
            ]
            await asyncio.gather(*(node.join() for node in nodes))
            rings = [FileKeyring(folder / "k.json") for folder in folders]
            assert rings[0].keys == rings[1].keys
            a, b = (rotate(ring.path) for ring in rings)
            for number, folder in enumerate(folders):
                revoke(folder / "r.json", [f"t-{number}"], NOW, NOW)
            lists = [Revocations(folder / "r.json") for folder in folders]
            while not (
                rings[0].keys == rings[1].keys
                and {a, b} <= set(rings[0].keys)
                and lists[0].ids == lists[1].ids == {"t-0", "t-1"}
            ):
                await asyncio.gather(*(node.share_changes() for node in nodes))
            assert await nodes[0].use("t", "ada", NOW - 2 * USED_KEPT_SECONDS)
            with pytest.raises(ProtocolError, match="auth/used"):
                await nodes[1].use("t", "bob", NOW)
            await nodes[0].share_changes()
            await nodes[0].release("t", "ada")
            assert await nodes[1].use("t", "bob", NOW)
