"""Addresses, origins and limits of visitors."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from websockets.datastructures import Headers

from robotouille.errors import ProtocolError
from robotouille_server.auth import visitors
from robotouille_server.auth.visitors import (
    PROBATION_FACTOR,
    AccessSettingError,
    CodeGuessLimiter,
    ConnectionLimiter,
    CountedConnection,
    TooManyConnectionsError,
    Visitor,
    counted_as,
    newcomer_group,
    newcomer_turn_group,
    origin_refusal,
    parse_networks,
    parse_origins,
    visitor,
)

FLAG = "--trust-proxy"
HERE = ("127.0.0.1", 50000)
PROXY = ("10.0.0.5", 50000)
HEADER_TEXT = st.text(st.sampled_from('for=;,:[]"%.0127abF ')) | st.text(
    st.characters(min_codepoint=32, max_codepoint=126)
)


def headers(**values: str | list[str]) -> Headers:
    found = Headers()
    for name, value in values.items():
        for one in [value] if isinstance(value, str) else value:
            found[name.replace("_", "-")] = one
    return found


def seen(peer: Any, trust: str = "", **values: str | list[str]) -> Visitor:
    return visitor(peer, headers(**values), parse_networks(trust, FLAG))


def test_program_on_this_machine_is_local() -> None:
    for peer in (HERE, ("127.8.9.1", 1), ("::1", 1, 0, 0), ("::ffff:127.0.0.1", 1, 0, 0)):
        for host in ({}, {"Host": "127.0.0.1:8765"}, {"Host": "LOCALHOST:1"}, {"Host": "[::1]:1"}):
            assert seen(peer, **host).local, (peer, host)


@pytest.mark.parametrize(
    "values",
    [
        {"X_Forwarded_For": "203.0.113.9"},
        {"X_Forwarded_For": "127.0.0.1"},
        {"X_Forwarded_For": ""},
        {"Forwarded": "for=127.0.0.1"},
        {"X_Real_IP": "127.0.0.1"},
        {"X_Forwarded_Host": "localhost"},
        {"Via": "1.1 proxy"},
        {"Host": "kitchen.example.org"},
        {"Host": "127.0.0.1.example.org"},
        {"Host": "localhost.example.org"},
        {"Host": ["localhost", "kitchen.example.org"]},
        {"Host": "kitchen.example.org:127"},
    ],
)
@pytest.mark.parametrize("trust", ["", "loopback"])
def test_client_behind_a_local_proxy_is_not_local(values: dict[str, str], trust: str) -> None:
    assert not seen(HERE, trust, **values).local


def test_headers_of_other_machines_do_not_make_them_local() -> None:
    for peer in (("203.0.113.9", 1), ("2001:db8::1", 1, 0, 0), ("", 1), None, "", ("what", 1), ()):
        assert not seen(peer, Host="localhost", X_Forwarded_For="127.0.0.1").local
        assert not seen(peer, "loopback", Host="localhost").local
    for peer in (None, "", ("what", 1), ()):
        assert seen(peer) == Visitor("unknown", False, "unknown")


@pytest.mark.parametrize(
    ("peer", "trust", "values", "address"),
    [
        # Without a trusted proxy, headers do not count.
        (("203.0.113.9", 1), "", {"X_Forwarded_For": "198.51.100.1"}, "203.0.113.9"),
        (HERE, "", {"X_Forwarded_For": "198.51.100.1"}, "127.0.0.1"),
        # A stranger in the network of the proxy cannot forge an address.
        (("203.0.113.9", 1), "private", {"X_Forwarded_For": "198.51.100.1"}, "203.0.113.9"),
        # One proxy: it added the last entry; the client sent the earlier ones.
        (HERE, "loopback", {"X_Forwarded_For": "198.51.100.1"}, "198.51.100.1"),
        (HERE, "loopback", {"X_Forwarded_For": "1.1.1.1, 127.0.0.1, 198.51.100.1"}, "198.51.100.1"),
        (HERE, "loopback", {"X_Forwarded_For": ["1.1.1.1", "198.51.100.1"]}, "198.51.100.1"),
        # Two proxies.
        (PROXY, "private", {"X_Forwarded_For": "9.9.9.9, 198.51.100.1, 10.0.0.6"}, "198.51.100.1"),
        (PROXY, "10.0.0.5", {"X_Forwarded_For": "198.51.100.1, 10.0.0.6"}, "10.0.0.6"),
        (PROXY, "private", {"X_Forwarded_For": "10.0.0.7, 10.0.0.6"}, "10.0.0.7"),
        # Ports, brackets, IPv6.
        (HERE, "loopback", {"X_Forwarded_For": "198.51.100.1:4711"}, "198.51.100.1"),
        (HERE, "loopback", {"X_Forwarded_For": "[2001:db8::1]:4711"}, "2001:db8::1"),
        (HERE, "loopback", {"X_Forwarded_For": "2001:db8::1"}, "2001:db8::1"),
        (HERE, "loopback", {"X_Forwarded_For": "::ffff:198.51.100.1"}, "198.51.100.1"),
        # The first invalid address ends the search.
        (HERE, "loopback", {"X_Forwarded_For": "198.51.100.1, unknown"}, "127.0.0.1"),
        (HERE, "loopback", {"X_Forwarded_For": "198.51.100.1, "}, "127.0.0.1"),
        (HERE, "loopback", {}, "127.0.0.1"),
        # `Forwarded` counts if the other header is missing.
        (HERE, "loopback", {"Forwarded": "for=198.51.100.1;proto=https"}, "198.51.100.1"),
        (HERE, "loopback", {"Forwarded": 'proto=https;For="[2001:db8::1]:47"'}, "2001:db8::1"),
        (PROXY, "private", {"Forwarded": "for=8.8.8.8, for=9.9.9.9, for=10.0.0.6"}, "9.9.9.9"),
        (HERE, "loopback", {"Forwarded": "for=_hidden"}, "127.0.0.1"),
        (
            HERE,
            "loopback",
            {"Forwarded": "for=8.8.8.8", "X_Forwarded_For": "198.51.100.1"},
            "198.51.100.1",
        ),
    ],
)
def test_address_is_the_last_trusted_one(
    peer: Any, trust: str, values: dict[str, Any], address: str
) -> None:
    assert seen(peer, trust, **values).address == address


def test_number_of_hops_is_limited() -> None:
    chain = ", ".join(["203.0.113.9"] + ["10.0.0.6"] * 5000)
    assert seen(PROXY, "private", X_Forwarded_For=chain).address == "10.0.0.6"


@example([("X-Forwarded-For", "[]")])
@given(st.lists(st.tuples(st.sampled_from(["X-Forwarded-For", "Forwarded", "Host"]), HEADER_TEXT)))
def test_malformed_headers_are_harmless(values: list[tuple[str, str]]) -> None:
    found = Headers()
    for name, value in values:
        found[name] = value
    assert visitor(HERE, found, parse_networks("private", FLAG)).address
    assert (
        visitor(("203.0.113.9", 1), found, parse_networks("private", FLAG)).address == "203.0.113.9"
    )


def test_ipv6_network_counts_as_one_address() -> None:
    one, other = seen(("2001:db8::1", 1, 0, 0)), seen(("2001:db8::ffff:2", 1, 0, 0))
    assert one.group == other.group != seen(("2001:db8:0:1::1", 1, 0, 0)).group
    assert one.address != other.address
    assert seen(("fe80::1%eth0", 1, 0, 2)).address == "fe80::1"
    assert seen(("203.0.113.9", 1)).group == "203.0.113.9"


def test_invalid_settings_are_reported() -> None:
    with pytest.raises(AccessSettingError, match="--trust-proxy: 'nginx' does not appear"):
        parse_networks("loopback, nginx", FLAG)
    with pytest.raises(AccessSettingError, match="--trust-proxy"):
        parse_networks("10.0.0.1/8", FLAG)
    for text in (
        "kitchen.example.org",
        "https://",
        "https://a.org/path",
        "*",
        "https://a:b",
        "null",
        "https://a.org:65536",
        "https://a.org?",
        "https://a.org#part",
        "https://:secret@a.org",
        "https://a;script-src *",
        "https://*.a.org",
        "https://a.org b.org",
        "https://straße.example",
        "https://bücher.example:65536",
    ):
        with pytest.raises(
            AccessSettingError, match=r"--origins: .* is not an origin; expected https://HOST"
        ):
            parse_origins(text)
    with pytest.raises(AccessSettingError, match=r"expected https://xn--bcher-kva\.example:8443$"):
        parse_origins("https://Bücher.example:8443")


ALLOWED = parse_origins("https://Kitchen.example.org/, http://localhost:3000")


@pytest.mark.parametrize(
    ("values", "admitted"),
    [
        ({}, True),
        ({"Origin": "https://kitchen.example.org"}, True),
        ({"Origin": "http://localhost:3000"}, True),
        ({"Origin": "http://kitchen.example.org"}, False),
        ({"Origin": "https://kitchen.example.org:8443"}, False),
        ({"Origin": "https://kitchen.example.org.evil.example"}, False),
        ({"Origin": "null"}, False),
        ({"Origin": ""}, False),
        ({"Origin": ["https://kitchen.example.org", "https://evil.example"]}, False),
    ],
)
def test_foreign_web_pages_are_refused(values: dict[str, Any], admitted: bool) -> None:
    refusal = origin_refusal(headers(**values), ALLOWED)
    assert (refusal is None) == admitted
    if refusal is not None:
        assert "--origins (ROBOTOUILLE_ORIGINS)" in refusal


def test_no_web_page_may_connect_by_default() -> None:
    assert origin_refusal(headers(Origin="http://127.0.0.1:8765"), parse_origins("")) is not None
    assert origin_refusal(headers(), parse_origins("")) is None


def guest(number: int) -> Visitor:
    address = f"203.0.{number // 256}.{number % 256}"
    return Visitor(address, False, address)


LOCAL = Visitor("127.0.0.1", True, "127.0.0.1")
FORWARDED = Visitor("127.0.0.1", False, "127.0.0.1")


class Door(ConnectionLimiter):
    """Limiter with a log of the connections it has closed."""

    def __init__(self, limit: int) -> None:
        super().__init__(limit)
        self.sent_away: list[int] = []

    def call(self, who: Visitor, number: int = 0) -> CountedConnection:
        caller = CountedConnection(who, lambda: self.sent_away.append(number))
        self.arrive(caller)
        return caller

    def enters(
        self, who: Visitor, subject: str = "", instead_of: CountedConnection | None = None
    ) -> bool:
        """Return whether a new connection is admitted."""
        caller = self.call(who)
        try:
            self.admit(caller, counted_as(who, subject), instead_of)
        except TooManyConnectionsError as error:
            assert error.code == "rate/connections"
            self.release(caller)
            return False
        return True


def test_strangers_of_an_address_do_not_displace_a_client_within_its_round_trip() -> None:
    door = Door(64)
    victim = door.call(guest(1), 1)
    for _ in range(PROBATION_FACTOR * 64 - 1):
        door.call(guest(1))
    assert door.sent_away == []
    door.admit(victim, guest(1))
    door.call(guest(1))
    assert door.sent_away == []
    # Welcomed connections have a smaller limit.
    assert [door.enters(guest(1)) for _ in range(64)] == [True] * 63 + [False]


def test_new_connection_replaces_the_oldest_silent_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(visitors, "PROBATION_FACTOR", 1)
    door = Door(2)
    callers = [door.call(guest(1), number) for number in range(3)]
    assert door.sent_away == [0]
    door.call(guest(2), 9)
    door.admit(callers[1], guest(1))
    door.call(guest(1), 3)
    assert door.sent_away == [0], "who has said hello is not on probation, other addresses apart"
    door.call(guest(1), 4)
    assert door.sent_away == [0, 2]
    for caller in callers:
        door.release(caller)


def test_slots_per_address_are_limited() -> None:
    door = Door(2)
    first = door.call(guest(1))
    door.admit(first, guest(1))
    assert [door.enters(guest(1)) for _ in range(3)] == [True, False, False]
    assert door.enters(guest(2))
    door.release(first)
    assert [door.enters(guest(1)) for _ in range(2)] == [True, False]


def network(number: int) -> Visitor:
    """Return a visitor from a /64 network of one /48."""
    return seen((f"2001:db8:1:{number:x}::1", 1, 0, 0))


def test_slots_per_ipv6_site_are_limited() -> None:
    """A household has many /64 networks, and a subject counts on its own."""
    door = Door(2)
    assert [door.enters(network(1)) for _ in range(3)] == [True, True, False]
    assert sum(door.enters(network(number)) for number in range(2, 100)) == 30
    assert not door.enters(network(100))
    assert door.enters(network(100), "p-1")
    assert door.enters(seen(("2001:db8:2::1", 1, 0, 0)))


def test_silent_connections_per_ipv6_site_are_limited() -> None:
    door = Door(1)
    callers = [door.call(network(number), number) for number in range(17)]
    assert door.sent_away == [0]
    for caller in callers:
        door.release(caller)
    assert door.groups == 0


def test_repeated_hello_takes_one_slot() -> None:
    """A `hello` that is refused for another reason, such as its name, may be sent again."""
    door = Door(2)
    caller = door.call(guest(1))
    for _ in range(5):
        door.admit(caller, guest(1))
    assert [door.enters(guest(1)) for _ in range(2)] == [True, False]
    door.release(caller)
    assert door.enters(guest(1))


@pytest.mark.parametrize(
    ("peer", "group"),
    [
        (("203.0.113.9", 4000), "203.0.113.9"),
        (("2001:db8:1:2:3::4", 4000, 0, 0), "2001:db8:1:2::/64"),
        (("127.0.0.1", 4000), ""),
        (("10.0.0.7", 4000), ""),
        (None, "unknown"),
    ],
)
def test_connections_without_request_count_by_their_socket(peer: object, group: str) -> None:
    assert newcomer_group(peer, parse_networks("10.0.0.0/8", "--trust-proxy")) == group


@pytest.mark.parametrize(
    ("peer", "group"),
    [
        (("203.0.113.9", 4000), "203.0.113.9"),
        (("2001:db8:1:2:3::4", 4000, 0, 0), "2001:db8:1::/48"),
        (("127.0.0.1", 4000), None),
        (("10.0.0.7", 4000), None),
        (None, "unknown"),
    ],
)
def test_connections_without_request_share_turns_by_their_socket(
    peer: object, group: str | None
) -> None:
    assert newcomer_turn_group(peer, parse_networks("10.0.0.0/8", "--trust-proxy")) == group


def test_token_bearers_count_by_subject() -> None:
    door = Door(2)
    assert [door.enters(guest(1)) for _ in range(3)] == [True, True, False]
    assert [door.enters(guest(n), "p-1") for n in (1, 2, 3)] == [True, True, False]
    assert door.enters(guest(1), "p-2")
    assert not door.enters(guest(1), "")


def test_returning_client_takes_over_the_slot() -> None:
    door = Door(1)
    first = door.call(guest(1))
    door.admit(first, guest(1))
    assert not door.enters(guest(1))
    assert door.enters(guest(1), instead_of=first)
    door.release(first)
    assert not door.enters(guest(1)), "the place is not given back twice"
    assert not door.enters(guest(1), instead_of=door.call(guest(2)))


def test_local_programs_are_not_limited() -> None:
    door = Door(1)
    assert all(door.enters(LOCAL) for _ in range(5))
    assert all(door.enters(LOCAL, "p-1") for _ in range(5))
    assert [door.enters(FORWARDED) for _ in range(2)] == [True, False]
    assert [door.enters(FORWARDED, "p-1") for _ in range(2)] == [True, False]
    assert door.sent_away == []


def test_closed_connections_are_forgotten() -> None:
    door = Door(1)
    for number in range(5000):
        one, other, third = (door.call(guest(number), number) for _ in range(3))
        door.admit(third, counted_as(guest(number), f"p-{number}"))
        assert door.groups == 2
        for caller in (one, other, third):
            door.release(caller)
            door.release(caller)
    assert door.groups == 0


def blocked(codes: CodeGuessLimiter, who: Visitor, now: float) -> bool:
    try:
        codes.check(who, now)
    except ProtocolError as error:
        assert (error.code, error.field) == ("rate/codes", "episode")
        return True
    return False


def test_wrong_codes_are_limited() -> None:
    codes = CodeGuessLimiter(burst=20)
    for _ in range(20):
        assert not blocked(codes, guest(1), 0.0)
        codes.wrong(guest(1), 0.0)
    assert blocked(codes, guest(1), 0.0)
    assert not blocked(codes, guest(2), 0.0)
    assert not blocked(codes, LOCAL, 0.0)
    assert blocked(codes, guest(1), 2.9)
    assert not blocked(codes, guest(1), 3.1)
    codes.wrong(guest(1), 3.1)
    assert blocked(codes, guest(1), 3.1)


def test_memory_is_bounded() -> None:
    codes = CodeGuessLimiter(burst=20, capacity=100)
    for number in range(10_000):
        codes.wrong(guest(number), number / 1000)
        assert len(codes) <= 100
    codes.wrong(guest(1), 1000.0)
    assert len(codes) == 1, "those whose budget is whole again are forgotten"
