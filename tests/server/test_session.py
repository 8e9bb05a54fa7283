"""A session is somebody, whatever connection they have at the moment."""

from __future__ import annotations

import pytest

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
