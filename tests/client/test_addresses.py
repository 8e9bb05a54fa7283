"""What is no address; where a server may send a client with its tokens, and where not."""

from __future__ import annotations

import asyncio

import pytest

from robotouille.protocol import messages
from robotouille_client.client import connect
from robotouille_client.console import server_url
from robotouille_client.errors import ConnectionFailedError, StrangerError
from robotouille_client.sansio.addresses import moved_url
from robotouille_client.sockets import server_uri


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


WRONG = [
    ("127.0.0.1:8765", "it begins with ws:// or wss://"),
    ("http://a:1", "it begins with ws:// or wss://, as in ws://a:1 or, with TLS, wss://a:1"),
    ("ws://", "hostname isn't provided"),
    ("ws://host:port", "a port is a number from 1 to 65535"),
    ("ws://localhost:87654", "a port is a number from 1 to 65535"),
    ("ws://localhost:0", "a port is a number from 1 to 65535"),
    ("ws://::1:8765", "(an IPv6 address stands in brackets)"),
    ("ws://[::1", "Invalid IPv6 URL"),
    ("ws://a..b:80", "no host can be called 'a..b'"),
    (f"ws://{'a' * 70}:80", "no host can be called 'aaaa"),
    ("ws://a\0b:80", "no host can be called 'a\\x00b'"),
    ("ws://a\udcff", "no host can be called"),
    ("ws://k\u00f6che.example/\udcff", "surrogates not allowed"),
    ("ws://user@host", "username provided without password"),
]


@pytest.mark.parametrize(("url", "fault"), WRONG)
def test_what_is_no_address_is_said_in_a_line(url: str, fault: str) -> None:
    with pytest.raises(ConnectionFailedError) as told:
        server_uri(url)
    words = str(told.value)
    assert words.startswith(f"{url!r} is no WebSocket URL like ws://host:8765: ")
    assert fault in words
    assert "\n" not in words


@pytest.mark.parametrize(
    "url", ["ws://localhost:8765", "wss://[::1]/x", "ws://k\u00f6che.example:1", "ws://a_b.c"]
)
def test_what_is_an_address_is_taken_apart(url: str) -> None:
    assert server_uri(url).host


@pytest.mark.parametrize("url", [url for url, _ in WRONG])
def test_whoever_connects_there_is_told(url: str) -> None:
    async def knock() -> None:
        async with connect(url, name="ada"):
            pass

    with pytest.raises(ConnectionFailedError, match="is no WebSocket URL"):
        asyncio.run(knock())


@pytest.mark.parametrize(
    ("url", "host", "port"),
    [
        (None, "localhost", 99999),
        (None, "localhost", 0),
        ("localhost:87654", "", 0),
        ("::1", "", 0),
    ],
)
def test_a_command_is_told_before_it_connects(url: str | None, host: str, port: int) -> None:
    with pytest.raises(ConnectionFailedError, match="a port is a number from 1 to 65535"):
        server_url(url, host, port)
