"""Addresses of servers, trusted redirects, and delays between attempts to connect."""

from __future__ import annotations

import random
from itertools import accumulate, islice

import pytest

from robotouille.protocol import messages
from robotouille_client.console import server_url
from robotouille_client.errors import ConnectionFailedError, UntrustedRedirectError
from robotouille_client.sansio.addresses import moved_url
from robotouille_client.sansio.attempts import reconnect_delays
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
def test_redirect_to_the_same_host_is_followed(here: str, there: str) -> None:
    assert moved_url(here, messages.Moved(episode="x", port=1, url=there)) == there


@pytest.mark.parametrize(
    ("there", "why"),
    [
        ("wss://evil.example/w1", "another host, 'evil.example'"),
        ("wss://kitchen.example.evil.example/", "another host"),
        ("wss://kitchen.example@evil.example/", "another host"),
        ("ws://kitchen.example/w1", "without TLS"),
        ("https://kitchen.example/", "which is not a ws:// or wss://"),
        ("//kitchen.example/", "which is not a ws:// or wss://"),
        ("wss://kitchen.example:99999/", "which is not an address"),
        ("wss://[kitchen.example/", "which is not an address"),
    ],
)
def test_redirect_elsewhere_is_refused(there: str, why: str) -> None:
    with pytest.raises(UntrustedRedirectError, match=why):
        moved_url("wss://kitchen.example", messages.Moved(episode="x", port=1, url=there))


@pytest.mark.parametrize("port", [-1, 0, 65_536, 10**30])
def test_redirect_to_an_invalid_port_is_refused(port: int) -> None:
    with pytest.raises(UntrustedRedirectError, match=f"redirects to port {port}, which is invalid"):
        moved_url("ws://127.0.0.1:8765", messages.Moved(episode="x", port=port))


@pytest.mark.parametrize(
    ("here", "there"),
    [
        ("ws://127.0.0.1:8765/a?b", "ws://127.0.0.1:9000/a?b"),
        ("wss://kitchen.example", "wss://kitchen.example:9000"),
        ("ws://[::1]:8765", "ws://[::1]:9000"),
    ],
)
def test_redirect_to_a_port_keeps_the_host(here: str, there: str) -> None:
    assert moved_url(here, messages.Moved(episode="x", port=9000)) == there


WRONG = [
    ("127.0.0.1:8765", "it must begin with ws:// or wss://"),
    ("http://a:1", "it must begin with ws:// or wss://, as in ws://a:1 or, with TLS, wss://a:1"),
    ("ws://", "hostname isn't provided"),
    ("ws://host:port", "a port is a number from 1 to 65535"),
    ("ws://localhost:87654", "a port is a number from 1 to 65535"),
    ("ws://localhost:0", "a port is a number from 1 to 65535"),
    ("ws://::1:8765", "(put an IPv6 address in brackets)"),
    ("ws://[::1", "Invalid IPv6 URL"),
    ("ws://a..b:80", "'a..b' is not a host name"),
    (f"ws://{'a' * 70}:80", "aaa' is not a host name"),
    ("ws://a\0b:80", "'a\\x00b' is not a host name"),
    ("ws://a\udcff", "is not a host name"),
    ("ws://k\u00f6che.example/\udcff", "surrogates not allowed"),
    ("ws://user@host", "username provided without password"),
]


@pytest.mark.parametrize(("url", "fault"), WRONG)
def test_invalid_address_is_explained_in_one_line(url: str, fault: str) -> None:
    with pytest.raises(ConnectionFailedError) as caught:
        server_uri(url)
    words = str(caught.value)
    assert words.startswith(f"{url!r} is not a WebSocket URL like ws://host:8765: ")
    assert fault in words
    assert "\n" not in words


@pytest.mark.parametrize(
    "url", ["ws://localhost:8765", "wss://[::1]/x", "ws://k\u00f6che.example:1", "ws://a_b.c"]
)
def test_valid_address_is_parsed(url: str) -> None:
    assert server_uri(url).host


@pytest.mark.parametrize(
    ("url", "host", "port"),
    [
        (None, "localhost", 99999),
        (None, "localhost", 0),
        ("localhost:87654", "", 0),
        ("::1", "", 0),
        ("ws://a,b:0", "", 0),
    ],
)
def test_commands_check_the_address_before_connecting(
    url: str | None, host: str, port: int
) -> None:
    with pytest.raises(ConnectionFailedError, match="a port is a number from 1 to 65535"):
        server_url(url, host, port)


def test_commands_take_several_addresses() -> None:
    assert server_url("a:1, wss://b ,ws://c", "", 0) == "ws://a:1,wss://b,ws://c"


def delays(seed: int, count: int = 18) -> list[float]:
    return list(islice(reconnect_delays(random.Random(seed)), count))


def test_reconnect_delays_of_many_clients_are_spread() -> None:
    for number, drawn in enumerate(zip(*map(delays, range(200)), strict=True)):
        late = 1.5 * 1.5 ** max(0, number - 11)
        longest = min(0.2 * 1.5**number, late, 5.0)
        assert min(drawn) < 0.55 * longest
        assert max(drawn) > 0.95 * longest


@pytest.mark.parametrize("takeover", [3.5, 5.0, 7.0, 8.0])
def test_clients_return_soon_after_another_node_takes_a_game_over(takeover: float) -> None:
    for seed in range(200):
        came = next(at for at in accumulate(delays(seed)) if at >= takeover)
        assert came <= takeover + 1.5
