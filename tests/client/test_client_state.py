"""The table of a client's life: each row is what really happens, and all else is illegal."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest

from robotouille import ProtocolError
from robotouille.protocol import messages
from robotouille_client.errors import ConnectionFailedError
from robotouille_client.sansio.client_protocol import ClientProtocol
from robotouille_client.sansio.client_state import TRANSITIONS, ClientState, Trigger, next_state
from robotouille_client.sansio.game_replica import GameReplica
from tests.support.scripted_server import CODE, ScriptedServer

Protocol = ClientProtocol[GameReplica]
ROWS = [(state, trigger) for state, row in TRANSITIONS.items() for trigger in row]
ILLEGAL = [(s, t) for s in ClientState for t in Trigger if t not in TRANSITIONS[s]]
JOIN = messages.Join(episode=CODE)
NOW = 100.0


class Script:
    """A client, and a server that says what a row needs."""

    def __init__(self) -> None:
        url = "ws://127.0.0.1:8765"
        self.server = ScriptedServer()
        self.client: Protocol = ClientProtocol(
            GameReplica, url=url, name="ada", rng=random.Random(1)
        )

    def tell(self, message: messages.ServerMessage) -> None:
        self.client.receive(message, NOW)

    def join(self) -> int:
        return self.client.request(JOIN, NOW)

    # To each state

    def to_offline(self) -> None:
        self.to_lobby()
        self.client.connection_lost(NOW)

    def to_moving(self) -> None:
        self.to_lobby()
        self.tell(self.server.moved(self.join()))

    def to_greeting(self) -> None:
        self.to_offline()
        self.client.connection_made(NOW)

    def to_lobby(self) -> None:
        self.client.connection_made(NOW)
        self.tell(self.server.welcome())

    def to_syncing(self) -> None:
        self.to_lobby()
        self.tell(self.server.joined(self.join()))

    def to_playing(self) -> None:
        self.to_syncing()
        self.tell(self.server.observation())

    def to_resuming(self) -> None:
        self._back(resumed=True)

    def to_rejoining(self) -> None:
        self._back(resumed=False)

    def _back(self, *, resumed: bool) -> None:
        self.to_playing()
        self.client.connection_lost(NOW)
        self.client.connection_made(NOW)
        self.tell(self.server.welcome(resumed=resumed))

    def to_closed(self) -> None:
        self.to_lobby()
        self.client.close()

    # What happens

    def connected(self) -> None:
        self.client.connection_made(NOW)

    def failed(self) -> None:
        self.client.connection_failed(ConnectionFailedError("nobody there"), NOW)

    def unknown(self) -> None:
        self.tell(self.server.error("auth/expired"))

    def welcomed(self) -> None:
        self.tell(self.server.welcome())

    def resumed(self) -> None:
        self.tell(self.server.welcome(resumed=True))

    def forgotten(self) -> None:
        self.client.membership = JOIN
        self.tell(self.server.welcome())

    def entered(self) -> None:
        self.tell(self.server.joined(episode="another"))

    def returned(self) -> None:
        self.tell(self.server.joined())

    def synced(self) -> None:
        self.tell(self.server.observation())

    def refused(self) -> None:
        while not isinstance(rejoin := self.client.next_message(), messages.Join):
            self.client.message_sent()
        self.tell(self.server.error("episode/full", rejoin.ref))

    def left(self) -> None:
        self.tell(messages.Left(episode="e1"))

    def moved(self) -> None:
        greeting = self.client.state is ClientState.GREETING
        self.tell(self.server.moved(None if greeting else self.join()))

    def lost(self) -> None:
        self.client.connection_lost(NOW)

    def close(self) -> None:
        self.client.close()

    def reach(self, state: ClientState) -> None:
        arrive: Callable[[], None] = getattr(self, f"to_{state.name.lower()}")
        arrive()
        assert self.client.state is state

    def cause(self, trigger: Trigger) -> None:
        happen: Callable[[], None] = getattr(self, trigger.name.lower())
        happen()


@pytest.mark.parametrize(("state", "trigger"), ROWS, ids=lambda x: x.name.lower())
def test_each_row_is_what_happens(state: ClientState, trigger: Trigger) -> None:
    script = Script()
    script.reach(state)
    script.cause(trigger)
    assert script.client.state is TRANSITIONS[state][trigger]


@pytest.mark.parametrize(("state", "trigger"), ILLEGAL, ids=lambda x: x.name.lower())
def test_all_else_is_illegal(state: ClientState, trigger: Trigger) -> None:
    with pytest.raises(ProtocolError) as caught:
        next_state(state, trigger)
    assert caught.value.code == "message/unexpected"


@pytest.mark.parametrize(
    ("state", "trigger"),
    [
        (ClientState.LOBBY, Trigger.CONNECTED),
        (ClientState.LOBBY, Trigger.FAILED),
        (ClientState.LOBBY, Trigger.WELCOMED),
        (ClientState.PLAYING, Trigger.RESUMED),
        (ClientState.OFFLINE, Trigger.RETURNED),
        (ClientState.OFFLINE, Trigger.LOST),
        (ClientState.MOVING, Trigger.LEFT),
        (ClientState.CLOSED, Trigger.CONNECTED),
        (ClientState.CLOSED, Trigger.WELCOMED),
    ],
    ids=lambda x: x.name.lower(),
)
def test_what_is_illegal_changes_nothing(state: ClientState, trigger: Trigger) -> None:
    script = Script()
    script.reach(state)
    game, url = script.client.game, script.client.url
    with pytest.raises(ProtocolError):
        script.cause(trigger)
    client = script.client
    assert (client.state, client.game, client.url) == (state, game, url)


def test_every_state_is_reached_and_every_trigger_leads_somewhere() -> None:
    reached = {state for row in TRANSITIONS.values() for state in row.values()}
    assert reached == set(ClientState)
    assert {trigger for row in TRANSITIONS.values() for trigger in row} == set(Trigger)
    assert set(TRANSITIONS) == set(ClientState)
