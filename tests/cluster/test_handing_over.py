"""Messages with which a node offers an episode to another one."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille_server.cluster.episodes.handing_over import Offer
from robotouille_server.cluster.episodes.journal import Tail

TAILS = st.builds(Tail, st.integers(0, 2**63), st.integers(0, 2**40), st.binary())


@given(st.text("0123456789abcdef"), st.none() | TAILS)
def test_offer_is_read_as_it_was_written(node: str, tail: Tail | None) -> None:
    assert Offer.decode(Offer(node, tail).encode()) == Offer(node, tail)


@pytest.mark.parametrize("text", [b"", b"n1", b"n1\n", b"n1\n1", b"n1\n1 x\n", b"n1\n1 2 3\n"])
def test_offer_without_valid_numbers_has_no_tail(text: bytes) -> None:
    assert Offer.decode(text) == Offer(text.partition(b"\n")[0].decode())


@given(st.binary())
def test_offer_may_be_anything(message: bytes) -> None:
    Offer.decode(message)
