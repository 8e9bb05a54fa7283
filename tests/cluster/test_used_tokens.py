"""Tokens for one session, on several nodes."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from structlog.testing import capture_logs

from robotouille.errors import ProtocolError
from robotouille_server.auth.revocation import USED_KEPT_SECONDS
from robotouille_server.cluster.keys.secrets import KEYS
from robotouille_server.cluster.keys.used_tokens import MAX_FORGOTTEN
from tests.support.shared_bucket import NOW, Node, Shared


async def test_token_is_used_by_one_session_of_the_cluster(
    pair: tuple[Node, Node], shared: Shared
) -> None:
    one, two = pair
    token = "id with spaces, é and *.>"
    assert await one.secrets.use(token, "ada", NOW + 60)
    assert not await one.secrets.use(token, "ada", NOW + 60)
    assert not await two.secrets.use(token, "ada", NOW + 60)
    with pytest.raises(ProtocolError) as caught:
        await two.secrets.use(token, "bob", NOW + 60)
    assert (caught.value.code, caught.value.field) == ("auth/used", "token")
    two.secrets.check_unused(token, "ada")
    two.secrets.check_unused("another")
    with pytest.raises(ProtocolError):
        two.secrets.check_unused(token)
    (name,) = set(shared.entries) - {KEYS}
    assert set(name) <= set("0123456789abcdefsu.")


async def test_one_of_two_simultaneous_uses_succeeds(pair: tuple[Node, Node]) -> None:
    uses = [node.secrets.use("t", f"s-{n}", NOW) for n, node in enumerate(pair * 2)]
    results = await asyncio.gather(*uses, return_exceptions=True)
    assert results.count(True) == 1
    assert sum(isinstance(result, ProtocolError) for result in results) == 3


async def test_released_token_can_be_used_by_another_session(pair: tuple[Node, Node]) -> None:
    one, two = pair
    await one.secrets.use("t", "ada", NOW)
    await two.secrets.release("t", "bob")
    with pytest.raises(ProtocolError):
        await two.secrets.use("t", "bob", NOW)
    await one.secrets.release("t", "ada")
    two.secrets.check_unused("t")
    assert await two.secrets.use("t", "bob", NOW)


async def test_failed_joins_of_a_token_are_limited(
    pair: tuple[Node, Node], shared: Shared, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each writes twice to NATS, so one token could keep the disks of all nodes busy."""
    one, _ = pair
    monkeypatch.setattr(asyncio.get_running_loop(), "time", lambda: 1000.0)
    for _ in range(20):
        await one.secrets.use("t", "ada", NOW)
        await one.secrets.release("t", "ada")
    with pytest.raises(ProtocolError) as caught:
        await one.secrets.use("t", "ada", NOW)
    assert caught.value.code == "rate/limited"
    assert set(shared.entries) == {KEYS}
    assert await one.secrets.use("another", "ada", NOW)


async def test_use_without_the_cluster_is_refused(pair: tuple[Node, Node]) -> None:
    one, _ = pair
    one.link.up = False
    with capture_logs(), pytest.raises(ProtocolError) as caught:
        await one.secrets.use("t", "ada", NOW)
    assert caught.value.code == "server/recording"
    one.link.up, one.link.answers = True, False
    with capture_logs(), pytest.raises(ProtocolError):
        await one.secrets.use("t", "ada", NOW)
    one.link.answers = True
    assert not await one.secrets.use("t", "ada", NOW), "the first attempt has used it"
    await one.secrets.release("t", "ada")
    one.link.up = False
    await one.secrets.release("t", "ada")


@pytest.mark.parametrize("value", [b"", b"{}", b'{"session": ""}' + b" " * 5000])
async def test_unreadable_use_counts_as_use(
    pair: tuple[Node, Node], shared: Shared, value: bytes
) -> None:
    one, _ = pair
    await one.secrets.use("t", "ada", NOW)
    (name,) = set(shared.entries) - {KEYS}
    with capture_logs():
        shared.change(name, value)
        with pytest.raises(ProtocolError, match="another session has used it"):
            await one.secrets.use("t", "ada", NOW)
        with pytest.raises(ProtocolError):
            one.secrets.check_unused("t", "ada")


async def test_uses_of_expired_tokens_are_deleted(shared: Shared, tmp_path: Path) -> None:
    now = [NOW]
    nodes = [Node(shared, tmp_path / str(n), wall=lambda: now[0]) for n in range(2)]
    for node in nodes:
        await node.secrets.join()
    for n in range(MAX_FORGOTTEN + 5):
        await nodes[0].secrets.use(f"t-{n}", "ada", NOW)
    await nodes[0].secrets.use("later", "ada", NOW + 2 * 3600)
    now[0] = NOW + USED_KEPT_SECONDS
    await nodes[1].secrets.share_changes()
    assert len(shared.entries) == 1 + MAX_FORGOTTEN + 6, "they are kept for a day"
    now[0] += 3600 - 1
    await nodes[1].secrets.share_changes()
    assert len(shared.entries) == 1 + MAX_FORGOTTEN + 6, "they are looked for once an hour"
    now[0] += 1
    for left in (6, 1, 1):
        await nodes[1].secrets.share_changes()
        assert len(shared.entries) == 1 + left
    nodes[0].secrets.check_unused("t-1", "bob")
    with pytest.raises(ProtocolError):
        nodes[0].secrets.check_unused("later", "bob")
