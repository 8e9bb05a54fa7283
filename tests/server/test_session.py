"""A session is somebody, whatever connection they have at the moment."""

from __future__ import annotations

import pytest

from robotouille import ProtocolError
from robotouille_server.auth import Role
from robotouille_server.rooms.session import Session


class Peer:
    """A connection over which so much has come."""

    def __init__(self, received_bytes: int) -> None:
        self.received_bytes = received_bytes


@pytest.fixture
def session() -> Session:
    return Session("s-1", name="Ada", kind="human", role=Role.PLAYER)


@pytest.mark.parametrize(
    ("view", "state", "text"), [("state", True, False), ("text", False, True), ("both", True, True)]
)
def test_a_view_is_of_the_state_or_of_words(
    session: Session, view: str, state: bool, text: bool
) -> None:
    session.view = view
    assert (session.view, session.wants_state, session.wants_text) == (view, state, text)


def test_who_has_no_token_is_their_own_participant(session: Session) -> None:
    assert session.participant == session.id
    known = Session("s-2", name="Bob", kind="bot", role=Role.PLAYER, participant="p-7")
    assert known.participant == "p-7"


def test_what_came_is_counted_over_all_connections(session: Session) -> None:
    assert session.received_bytes == 0
    session.peer = Peer(100)  # type: ignore[assignment]
    assert session.received_bytes == 100
    session.disconnected()
    assert session.peer is None
    session.peer = Peer(10)  # type: ignore[assignment]
    assert session.received_bytes == 110


def test_a_spectator_has_no_seat(session: Session) -> None:
    assert (session.player, session.views, session.has_several) == (None, (None,), False)
    for seat in (None, "robot1"):
        with pytest.raises(ProtocolError, match="you watch") as caught:
            session.own_seat(seat)
        assert caught.value.code == "seat/none"


def test_whoever_has_one_seat_is_not_told_which(session: Session) -> None:
    session.players = ("robot2",)
    assert (session.player, session.views, session.has_several) == ("robot2", ("robot2",), False)
    assert [session.own_seat(None), session.own_seat("robot2")] == ["robot2", "robot2"]
    assert [session.seat_shown(seat) for seat in (None, "robot2", "robot9")] == ["", "", ""]


def test_of_several_seats_the_first_is_meant_where_nothing_is_said(session: Session) -> None:
    session.players = ("robot1", "robot3")
    assert [session.own_seat(None), session.own_seat("robot3")] == ["robot1", "robot3"]
    assert [session.seat_shown(None), session.seat_shown("robot3")] == ["robot1", "robot3"]
    with pytest.raises(ProtocolError, match="robot2 is not yours: you play robot1 and robot3") as e:
        session.own_seat("robot2")
    assert (e.value.code, e.value.field) == ("seat/unknown", "seat")
