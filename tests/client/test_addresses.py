"""Where a server may send a client with its tokens, and where not."""

from __future__ import annotations

import pytest

from robotouille.protocol import messages
from robotouille_client.errors import StrangerError
from robotouille_client.sansio.addresses import moved_url


@pytest.mark.parametrize(
    ("here", "there"),
    [
        ("wss://kitchen.example/x", "wss://kitchen.example/w1"),
        ("wss://kitchen.example", "wss://KITCHEN.example:8766/"),
        ("ws://kitchen.example:8765", "wss://kitchen.example/w1"),
        ("ws://[::1]:8765", "ws://[::1]:8766"),
    ],
)
def test_another_process_of_the_same_host_is_gone_to(here: str, there: str) -> None:
    assert moved_url(here, messages.Moved(episode="x", port=1, url=there)) == there


@pytest.mark.parametrize(
    ("there", "why"),
    [
        ("wss://evil.example/w1", "'evil.example', another host"),
        ("wss://kitchen.example.evil.example/", "another host"),
        ("wss://kitchen.example@evil.example/", "another host"),
        ("ws://kitchen.example/w1", "without TLS"),
        ("https://kitchen.example/", "which is no ws:// or wss://"),
        ("//kitchen.example/", "which is no ws:// or wss://"),
        ("wss://kitchen.example:99999/", "which is no address"),
        ("wss://[kitchen.example/", "which is no address"),
    ],
)
def test_anywhere_else_is_not(there: str, why: str) -> None:
    with pytest.raises(StrangerError, match=why):
        moved_url("wss://kitchen.example", messages.Moved(episode="x", port=1, url=there))


@pytest.mark.parametrize("port", [-1, 0, 65_536, 10**30])
def test_a_port_that_is_none_is_named(port: int) -> None:
    with pytest.raises(StrangerError, match=f"sends us to port {port}, which is none"):
        moved_url("ws://127.0.0.1:8765", messages.Moved(episode="x", port=port))


@pytest.mark.parametrize(
    ("here", "there"),
    [
        ("ws://127.0.0.1:8765/a?b", "ws://127.0.0.1:9000/a?b"),
        ("wss://kitchen.example", "wss://kitchen.example:9000"),
        ("ws://[::1]:8765", "ws://[::1]:9000"),
    ],
)
def test_a_port_is_one_of_the_same_host(here: str, there: str) -> None:
    assert moved_url(here, messages.Moved(episode="x", port=9000)) == there
