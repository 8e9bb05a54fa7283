"""Who is connecting, and whether they may."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from websockets.datastructures import Headers

from robotouille.errors import ProtocolError
from robotouille_server.auth.visitors import (
    AccessSettingError,
    CodeGuessLimiter,
    ConnectionLimiter,
    CountedConnection,
    TooManyConnectionsError,
    Visitor,
    comes_from,
    counted_as,
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


def test_a_program_on_this_machine_is_local() -> None:
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
def test_somebody_behind_a_proxy_on_this_machine_is_not(values: dict[str, str], trust: str) -> None:
    assert not seen(HERE, trust, **values).local


def test_other_machines_are_not_local_whatever_they_say() -> None:
    for peer in (("203.0.113.9", 1), ("2001:db8::1", 1, 0, 0), ("", 1), None, "", ("what", 1), ()):
        assert not seen(peer, Host="localhost", X_Forwarded_For="127.0.0.1").local
        assert not seen(peer, "loopback", Host="localhost").local
    for peer in (None, "", ("what", 1), ()):
        assert seen(peer) == Visitor("unknown", False, "unknown")


@pytest.mark.parametrize(
    ("peer", "trust", "values", "address"),
    [
        # Nobody is trusted: what they say does not count.
        (("203.0.113.9", 1), "", {"X_Forwarded_For": "198.51.100.1"}, "203.0.113.9"),
        (HERE, "", {"X_Forwarded_For": "198.51.100.1"}, "127.0.0.1"),
        # A stranger beside the proxy cannot pass for somebody else.
        (("203.0.113.9", 1), "private", {"X_Forwarded_For": "198.51.100.1"}, "203.0.113.9"),
        # One proxy: the last entry is what it saw; the ones before are what the client said.
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
        # What is no address ends the walk.
        (HERE, "loopback", {"X_Forwarded_For": "198.51.100.1, unknown"}, "127.0.0.1"),
        (HERE, "loopback", {"X_Forwarded_For": "198.51.100.1, "}, "127.0.0.1"),
        (HERE, "loopback", {}, "127.0.0.1"),
        # The standard's header counts where the other is missing.
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
def test_the_address_is_the_last_that_can_be_believed(
    peer: Any, trust: str, values: dict[str, Any], address: str
) -> None:
    assert seen(peer, trust, **values).address == address


def test_a_long_chain_is_not_followed_for_ever() -> None:
    chain = ", ".join(["203.0.113.9"] + ["10.0.0.6"] * 5000)
    assert seen(PROXY, "private", X_Forwarded_For=chain).address == "10.0.0.6"


@example([("X-Forwarded-For", "[]")])
@given(st.lists(st.tuples(st.sampled_from(["X-Forwarded-For", "Forwarded", "Host"]), HEADER_TEXT)))
def test_no_header_can_confuse(values: list[tuple[str, str]]) -> None:
    found = Headers()
    for name, value in values:
        found[name] = value
    assert visitor(HERE, found, parse_networks("private", FLAG)).address
    assert (
        visitor(("203.0.113.9", 1), found, parse_networks("private", FLAG)).address == "203.0.113.9"
    )


def test_an_ipv6_network_counts_as_one() -> None:
    one, other = seen(("2001:db8::1", 1, 0, 0)), seen(("2001:db8::ffff:2", 1, 0, 0))
    assert one.group == other.group != seen(("2001:db8:0:1::1", 1, 0, 0)).group
    assert one.address != other.address
    assert seen(("fe80::1%eth0", 1, 0, 2)).address == "fe80::1"
    assert seen(("203.0.113.9", 1)).group == "203.0.113.9"


def test_wrong_settings_are_named() -> None:
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
    ):
        with pytest.raises(AccessSettingError, match=r"--origins: .* is no origin; write it as"):
            parse_origins(text)


def test_a_request_comes_from_a_network_only_if_nobody_has_passed_it_on() -> None:
    private = parse_networks("private", "--metrics-from")
    assert comes_from(PROXY, headers(), private)
    assert not comes_from(PROXY, headers(), ())
    assert not comes_from(("203.0.113.9", 1), headers(), private)
    assert not comes_from(PROXY, headers(X_Forwarded_For="10.0.0.9"), private)
    assert not comes_from(PROXY, headers(Via="1.1 caddy"), private)
    assert not comes_from("unix", headers(), private)


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
def test_pages_of_other_sites_are_refused(values: dict[str, Any], admitted: bool) -> None:
    refusal = origin_refusal(headers(**values), ALLOWED)
    assert (refusal is None) == admitted
    if refusal is not None:
        assert "--origins (ROBOTOUILLE_ORIGINS)" in refusal


def test_without_a_list_no_page_may_connect() -> None:
    """A page that somebody looks at cannot reach the server on their machine."""
    assert origin_refusal(headers(Origin="http://127.0.0.1:8765"), parse_origins("")) is not None
    assert origin_refusal(headers(), parse_origins("")) is None


def guest(number: int) -> Visitor:
    address = f"203.0.{number // 256}.{number % 256}"
    return Visitor(address, False, address)


LOCAL = Visitor("127.0.0.1", True, "127.0.0.1")
FORWARDED = Visitor("127.0.0.1", False, "127.0.0.1")


class Door(ConnectionLimiter):
    """A doorkeeper, and who was sent away from probation."""

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
        """Whether somebody new comes in."""
        caller = self.call(who)
        try:
            self.admit(caller, counted_as(who, subject), instead_of)
        except TooManyConnectionsError as error:
            assert error.code == "rate/connections"
            self.release(caller)
            return False
        return True


def test_a_newcomer_takes_the_place_of_the_one_that_is_silent_the_longest() -> None:
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


def test_each_address_has_so_many_places() -> None:
    door = Door(2)
    first = door.call(guest(1))
    door.admit(first, guest(1))
    assert [door.enters(guest(1)) for _ in range(3)] == [True, False, False]
    assert door.enters(guest(2))
    door.release(first)
    assert [door.enters(guest(1)) for _ in range(2)] == [True, False]


def test_who_brings_a_token_is_counted_by_its_subject_from_everywhere() -> None:
    door = Door(2)
    assert [door.enters(guest(1)) for _ in range(3)] == [True, True, False]
    assert [door.enters(guest(n), "p-1") for n in (1, 2, 3)] == [True, True, False]
    assert door.enters(guest(1), "p-2")
    assert not door.enters(guest(1), "")


def test_who_comes_back_has_the_place_of_the_connection_it_replaces() -> None:
    door = Door(1)
    first = door.call(guest(1))
    door.admit(first, guest(1))
    assert not door.enters(guest(1))
    assert door.enters(guest(1), instead_of=first)
    door.release(first)
    assert not door.enters(guest(1)), "the place is not given back twice"
    assert not door.enters(guest(1), instead_of=door.call(guest(2)))


def test_this_machine_is_not_limited_but_what_it_forwards_is() -> None:
    door = Door(1)
    assert all(door.enters(LOCAL) for _ in range(5))
    assert all(door.enters(LOCAL, "p-1") for _ in range(5))
    assert [door.enters(FORWARDED) for _ in range(2)] == [True, False]
    assert [door.enters(FORWARDED, "p-1") for _ in range(2)] == [True, False]
    assert door.sent_away == []


def test_the_counts_hold_nobody_who_has_gone() -> None:
    door = Door(1)
    for number in range(5000):
        one, other, third = (door.call(guest(number), number) for _ in range(3))
        door.admit(third, counted_as(guest(number), f"p-{number}"))
        assert door.groups == 1
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


def test_wrong_codes_run_out_and_come_back() -> None:
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


def test_a_guesser_locks_nobody_out_who_has_a_token() -> None:
    codes = CodeGuessLimiter(burst=20)
    for _ in range(20):
        codes.wrong(guest(1), 0.0)
    assert blocked(codes, guest(1), 0.0)
    holder = counted_as(guest(1), "p-1")
    for _ in range(20):
        assert not blocked(codes, holder, 0.0)
        codes.wrong(holder, 0.0)
    assert blocked(codes, counted_as(guest(2), "p-1"), 0.0), "from wherever they guess"
    assert not blocked(codes, counted_as(guest(1), "p-2"), 0.0)


def test_guessing_stays_slow_for_ever() -> None:
    """An hour of trying as often as possible: 20 at once and 20 a minute."""
    codes, tried = CodeGuessLimiter(burst=20), 0
    for tick in range(36_000):
        if not blocked(codes, guest(1), tick / 10):
            codes.wrong(guest(1), tick / 10)
            tried += 1
    assert 1200 <= tried <= 1220


def test_many_addresses_do_not_fill_the_memory() -> None:
    codes = CodeGuessLimiter(burst=20, capacity=100)
    for number in range(10_000):
        codes.wrong(guest(number), number / 1000)
        assert len(codes) <= 100
    codes.wrong(guest(1), 1000.0)
    assert len(codes) == 1, "those whose budget is whole again are forgotten"


def test_programs_of_this_machine_are_not_counted() -> None:
    codes = CodeGuessLimiter(burst=1)
    for _ in range(9):
        codes.wrong(LOCAL, 0.0)
    assert len(codes) == 0
    assert not blocked(codes, FORWARDED, 0.0)
