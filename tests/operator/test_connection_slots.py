"""Who makes room for whom at the operator's port."""

from __future__ import annotations

import pytest

from robotouille_server.admin.errors import RequestRefusedError
from robotouille_server.admin.http.connection_slots import (
    MAX_CONNECTIONS,
    MAX_PER_ADDRESS,
    MAX_PER_SUBJECT,
    ConnectionSlot,
    ConnectionSlots,
    Standing,
)


class Crowd:
    """Places, and who has been cut off, by the order in which they came."""

    def __init__(self) -> None:
        self.places = ConnectionSlots()
        self.cut: list[int] = []
        self._came = 0

    def come(self, address: str = "127.0.0.1") -> ConnectionSlot | None:
        number, self._came = self._came, self._came + 1
        return self.places.take((address, 50_000 + number), lambda: self.cut.append(number))

    def fill(self, count: int, address: str = "127.0.0.1") -> list[ConnectionSlot]:
        places = [place for _ in range(count) if (place := self.come(address)) is not None]
        assert len(places) == count
        return places


def test_silence_goes_before_idleness_and_that_before_being_answered() -> None:
    crowd = Crowd()
    some = crowd.fill(MAX_CONNECTIONS)
    for place in some[4:]:
        place.know(f"lab-{some.index(place) // MAX_PER_SUBJECT}")
    for place in some[:3]:
        place.stand(Standing.BUSY)
    some[2].answered()
    crowd.come()
    crowd.come()
    assert crowd.cut == [3, MAX_CONNECTIONS]
    last = crowd.come()
    assert last is not None
    last.stand(Standing.BUSY)
    for _ in range(3):
        newcomer = crowd.come()
        assert newcomer is not None
        newcomer.stand(Standing.BUSY)
    assert crowd.cut[3:] == [2, 0, 1]
    assert len(crowd.places) == MAX_CONNECTIONS


def test_where_all_have_shown_tokens_nobody_else_comes_in() -> None:
    crowd = Crowd()
    for number, place in enumerate(crowd.fill(MAX_CONNECTIONS)):
        place.know(f"lab-{number // MAX_PER_SUBJECT}")
    assert crowd.come() is None
    assert crowd.cut == []


def test_one_token_does_not_fill_the_port() -> None:
    crowd = Crowd()
    places = crowd.fill(MAX_PER_SUBJECT + 1)
    for place in places[:-1]:
        place.know("lab")
    places[0].know("lab")
    with pytest.raises(RequestRefusedError, match="operator/busy"):
        places[-1].know("lab")
    places[-1].know("other")


def test_an_address_has_so_many_places_and_this_machine_all() -> None:
    crowd = Crowd()
    crowd.fill(MAX_PER_ADDRESS, "203.0.113.7")[0].know("lab")
    crowd.come("203.0.113.7")
    assert crowd.cut == []
    crowd.come("203.0.113.7")
    assert crowd.cut == [1]
    crowd.come("203.0.113.8")
    crowd.fill(MAX_PER_ADDRESS + 5)
    assert crowd.cut == [1]


def test_an_ipv6_network_counts_as_one_address() -> None:
    crowd = Crowd()
    for number in range(MAX_PER_ADDRESS + 1):
        crowd.come(f"2001:db8::{number:x}")
    assert crowd.cut == [0]
