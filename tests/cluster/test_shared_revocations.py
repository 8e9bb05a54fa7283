"""Revoked tokens that nodes share."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from structlog.testing import capture_logs

from robotouille_server.auth.revocation import (
    KEPT_SECONDS,
    MAX_ENTRIES,
    Revocations,
    encode_revoked,
    load_revoked,
    revoke,
)
from robotouille_server.cluster.keys.secrets import (
    KEYS,
    MAX_VALUE_BYTES,
    REVOKED,
)
from tests.support.shared_bucket import NOW, Node, Shared, errors


async def test_revocations_reach_all_nodes(pair: tuple[Node, Node], shared: Shared) -> None:
    one, two = pair
    revoked = Revocations(one.revoked)
    one.revoke("a")
    two.revoke("b", expires=NOW + 60)
    await asyncio.gather(one.secrets.share_changes(), two.secrets.share_changes())
    assert revoked.ids == {"a", "b"}
    assert load_revoked(two.revoked) == load_revoked(one.revoked)
    assert load_revoked(one.revoked)["b"] == NOW + 60 + KEPT_SECONDS
    assert set(shared.entries) == {KEYS, REVOKED}


async def test_revocations_are_known_before_the_server_starts(
    shared: Shared, tmp_path: Path
) -> None:
    one, two = Node(shared, tmp_path / "a"), Node(shared, tmp_path / "b")
    one.keys.parent.mkdir(parents=True)
    one.revoke("a")
    await one.secrets.join()
    await two.secrets.join()
    assert "a" in Revocations(two.revoked)


async def test_outdated_revocations_are_forgotten(shared: Shared, tmp_path: Path) -> None:
    now = [NOW]
    node = Node(shared, tmp_path / "a", wall=lambda: now[0])
    await node.secrets.join()
    node.revoke("a")
    await node.secrets.share_changes()
    now[0] = NOW + KEPT_SECONDS + 1
    revision = shared.revision
    await node.secrets.share_changes()
    assert shared.revision == revision
    revoke(node.revoked, ["b"], now[0], now[0])
    await node.secrets.share_changes()
    late = Node(shared, tmp_path / "b", wall=lambda: now[0])
    await late.secrets.join()
    assert set(load_revoked(late.revoked)) == {"b"}


@pytest.mark.parametrize(
    "value",
    [
        b"",
        b"{}",
        b'{"revoked": [{"id": 7, "until": 1.0}]}',
        b'{"revoked": []}' + b" " * MAX_VALUE_BYTES,
        encode_revoked({str(n): NOW * 2 for n in range(MAX_ENTRIES + 1)}, indent=None),
    ],
)
async def test_invalid_list_of_the_cluster_is_replaced(
    pair: tuple[Node, Node], shared: Shared, value: bytes
) -> None:
    one, two = pair
    one.revoke("a")
    await one.secrets.share_changes()
    with capture_logs() as logs:
        shared.change(REVOKED, value)
    assert len(errors(logs)) == 2
    assert set(load_revoked(one.revoked)) == set(load_revoked(two.revoked)) == {"a"}
    await two.secrets.share_changes()
    assert REVOKED in shared.entries
    two.revoke("b")
    await two.secrets.share_changes()
    assert set(load_revoked(one.revoked)) == {"a", "b"}


@pytest.mark.slow
async def test_longest_list_fits_into_the_bucket(pair: tuple[Node, Node]) -> None:
    one, two = pair
    one.revoke(*(f"{n:064}" for n in range(MAX_ENTRIES)))
    await one.secrets.share_changes()
    assert len(load_revoked(two.revoked)) == MAX_ENTRIES


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mine", "theirs"),
    [
        ([f"a{n}" for n in range(MAX_ENTRIES)], ["b"]),
        ([], ["\N{PILE OF POO}" * 60 + str(n) for n in range(5000)]),
    ],
)
async def test_too_many_revocations_are_reported_once(
    pair: tuple[Node, Node], mine: list[str], theirs: list[str]
) -> None:
    one, two = pair
    if mine:
        one.revoke(*mine)
    await one.secrets.share_changes()
    two.link.deaf = True
    two.revoked.unlink(missing_ok=True)
    two.revoke(*theirs)
    with capture_logs() as logs:
        for _ in range(3):
            await two.secrets.share_changes()
    assert len(errors(logs)) == 1
    assert "rotate the keys" in errors(logs)[0]
    assert set(theirs) <= set(load_revoked(two.revoked))
