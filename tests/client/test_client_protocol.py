"""A client's side of the protocol, by itself: no sockets, no clock."""

from __future__ import annotations

import random
import subprocess
import sys

import pytest

from robotouille import ProtocolError
from robotouille.protocol import messages
from robotouille_client.errors import ConnectionFailedError, NotYetError, StrangerError
from robotouille_client.sansio.client_protocol import ClientProtocol
from robotouille_client.sansio.client_requests import RequestDone, RequestFailed
from robotouille_client.sansio.client_state import ClientState
from robotouille_client.sansio.game_events import Over
from robotouille_client.sansio.game_replica import GameReplica
from tests.support.scripted_server import CODE, ScriptedServer

Protocol = ClientProtocol[GameReplica]
URL = "ws://127.0.0.1:8765"
JOIN = messages.Join(episode=CODE)


@pytest.fixture
def server() -> ScriptedServer:
    return ScriptedServer()


def new(**options: object) -> Protocol:
    options = {"url": URL, "name": "ada", "rng": random.Random(1), **options}
    return ClientProtocol(GameReplica, **options)  # type: ignore[arg-type]


def sent(client: Protocol) -> list[messages.Message]:
    """All that there is to send."""
    found = []
    while (message := client.next_message()) is not None:
        found.append(message)
        client.message_sent()
    return found


def in_lobby(server: ScriptedServer, **options: object) -> Protocol:
    client = new(**options)
    client.connection_made(0.0)
    sent(client)
    client.receive(server.welcome(), 0.0)
    return client


def playing(server: ScriptedServer, **options: object) -> Protocol:
    client = in_lobby(server, **options)
    ref = client.request(JOIN, 0.0)
    sent(client)
    client.receive(server.joined(ref), 0.0)
    client.receive(server.snapshot(), 0.0)
    client.events()
    return client


def come_back(client: Protocol, server: ScriptedServer, *, resumed: bool, now: float) -> None:
    client.connection_lost(now)
    client.connection_made(now)
    sent(client)
    client.receive(server.welcome(resumed=resumed), now)


def failure(client: Protocol) -> Exception:
    (event,) = client.events()
    assert isinstance(event, RequestFailed)
    return event.error


@pytest.mark.process
def test_it_needs_neither_asyncio_nor_sockets() -> None:
    program = (
        "import sys, robotouille_client.sansio.client_protocol\n"
        "assert not {'asyncio', 'websockets'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_hello_is_first_and_requests_wait_for_its_answer(server: ScriptedServer) -> None:
    client = new(token="role")
    ref = client.request(messages.ListEpisodes(), 0.0)
    assert sent(client) == []
    client.connection_made(1.0)
    assert sent(client) == [messages.Hello(protocol=1, name="ada", kind="bot", token="role")]
    client.receive(server.welcome(), 1.0)
    assert (client.role, client.resume) == ("host", "resume-1")
    assert sent(client) == [messages.ListEpisodes(ref=ref)]
    client.receive(messages.Episodes(ref=ref, episodes=[]), 1.0)
    assert client.events() == [RequestDone(ref, messages.Episodes(ref=ref, episodes=[]))]


def test_a_join_is_answered_once_its_first_snapshot_is_there(server: ScriptedServer) -> None:
    client = in_lobby(server)
    ref = client.request(JOIN, 0.0)
    client.receive(server.joined(ref, resume="seat"), 0.0)
    assert (client.events(), client.resume) == ([], "seat")
    client.receive(server.snapshot(), 0.0)
    assert [event.ref for event in client.events()] == [ref]
    assert client.membership is not None
    assert client.membership.episode == CODE


def test_a_message_that_did_not_go_out_goes_over_the_next_connection(
    server: ScriptedServer,
) -> None:
    client = playing(server)
    assert client.game is not None
    client.game.say("hello?")
    said = client.next_message()
    come_back(client, server, resumed=True, now=1.0)
    assert sent(client) == [said]


def test_what_was_asked_is_asked_again_but_nothing_is_created_twice(
    server: ScriptedServer,
) -> None:
    client = in_lobby(server)
    client.request(messages.Create(), 0.0)
    ref = client.request(messages.ListEpisodes(), 0.0)
    assert len(sent(client)) == 2
    come_back(client, server, resumed=True, now=1.0)
    assert sent(client) == [messages.ListEpisodes(ref=ref)]


def test_a_resumed_game_is_told_what_it_has_seen_and_acts_again(server: ScriptedServer) -> None:
    client = playing(server)
    game = client.game
    assert game is not None
    game.propose(None, 0.0)
    (act,) = sent(client)
    client.connection_lost(1.0)
    client.connection_made(1.0)
    (hello,) = sent(client)
    assert isinstance(hello, messages.Hello)
    assert (hello.resume, hello.token, hello.view) == ("resume-1", None, "state")
    assert hello.seen == messages.Seen(episode="e1")
    client.receive(server.welcome(resumed=True), 1.0)
    assert sent(client) == []
    client.receive(server.joined(), 1.0)
    assert sent(client) == [act]
    assert client.game is game


def test_who_was_forgotten_takes_the_seat_anew_without_the_action(server: ScriptedServer) -> None:
    client = playing(server)
    game = client.game
    assert game is not None
    seq = game.propose(None, 0.0)
    sent(client)
    come_back(client, server, resumed=False, now=1.0)
    game.propose(None, 1.0)
    (join,) = sent(client)
    assert isinstance(join, messages.Join)
    assert (join.episode, join.seat) == (CODE, "robot1")
    client.receive(server.joined(join.ref), 1.0)
    assert [(s, r.code) for s, r in game.results()] == [(seq, "seat/lost"), (seq + 1, "seat/lost")]
    assert sent(client) == []


@pytest.mark.parametrize("code", ["server/handover", "server/recording", "rate/limited"])
def test_a_seat_that_cannot_be_had_now_is_asked_for_again(
    server: ScriptedServer, code: str
) -> None:
    client = playing(server)
    come_back(client, server, resumed=False, now=1.0)
    (join,) = sent(client)
    assert isinstance(join, messages.Join)
    client.receive(server.error(code, join.ref), 1.0)
    assert client.get_timer() == 1.5
    client.handle_timer(1.4)
    assert sent(client) == []
    client.handle_timer(1.5)
    assert sent(client) == [join]


def test_a_seat_that_was_to_be_asked_for_again_is_asked_for_once_on_the_next_line(
    server: ScriptedServer,
) -> None:
    client = playing(server)
    come_back(client, server, resumed=False, now=1.0)
    (join,) = sent(client)
    assert isinstance(join, messages.Join)
    client.receive(server.error("server/handover", join.ref), 1.0)
    client.connection_lost(1.1)
    assert client.get_timer() is None
    client.handle_timer(1.5)
    client.connection_made(2.0)
    sent(client)
    client.receive(server.welcome(), 2.0)
    assert [type(message) for message in sent(client)] == [messages.Join]


def test_a_seat_that_is_lost_ends_the_game_and_not_the_connection(server: ScriptedServer) -> None:
    client = playing(server)
    game = client.game
    assert game is not None
    come_back(client, server, resumed=False, now=1.0)
    (join,) = sent(client)
    assert isinstance(join, messages.Join)
    client.receive(server.error("episode/full", join.ref), 1.0)
    assert game.poll()[-1] == Over({}, "no", "episode/full")
    assert (client.state, client.membership) == (ClientState.LOBBY, None)


@pytest.mark.parametrize("code", ["auth/expired", "auth/invalid", "auth/required", "auth/revoked"])
def test_a_resume_token_that_is_worth_nothing_gives_way_to_the_role_token(
    server: ScriptedServer, code: str
) -> None:
    client = new(token="role", resume="old")
    client.connection_made(0.0)
    (first,) = sent(client)
    client.receive(server.error(code), 0.0)
    (second,) = sent(client)
    assert isinstance(first, messages.Hello)
    assert isinstance(second, messages.Hello)
    assert (first.resume, first.token) == ("old", None)
    assert (second.resume, second.token) == (None, "role")
    client.receive(server.error(code), 0.0)
    assert isinstance(client.error, ProtocolError)


def test_pauses_grow_while_it_is_away_and_begin_anew(server: ScriptedServer) -> None:
    client = in_lobby(server)
    client.connection_lost(0.0)
    waits = [client.connect_at]
    for _ in range(4):
        client.connection_failed(ConnectionFailedError("no"), client.connect_at)
        waits.append(client.connect_at - sum(waits))
    for wait, longest in zip(waits, [0.2, 0.4, 0.8, 1.6, 3.2], strict=True):
        assert longest / 2 <= wait <= longest
    client.connection_made(10.0)
    client.receive(server.welcome(resumed=True), 10.0)
    client.connection_lost(10.0)
    assert client.connect_at <= 10.2


def test_the_first_connection_is_sought_once(server: ScriptedServer) -> None:
    client = new()
    client.connection_failed(ConnectionFailedError("nobody there"), 0.0)
    assert client.state is ClientState.CLOSED
    assert str(client.error) == "nobody there"
    with pytest.raises(ConnectionFailedError, match="nobody there"):
        client.request(JOIN, 0.0)


def test_without_reconnect_a_lost_connection_is_the_end(server: ScriptedServer) -> None:
    client = playing(server, reconnect=False)
    assert client.game is not None
    client.connection_lost(1.0)
    assert client.state is ClientState.CLOSED
    assert client.farewell == "the connection was closed"
    assert isinstance(client.game.poll()[-1], Over)


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        (messages.Error(code="server/handover", message="soon"), NotYetError),
        (messages.Bye(reason="full", retry=True), NotYetError),
        (messages.Left(episode="e1"), NotYetError),
        (messages.Error(code="auth/required", message="a token"), ProtocolError),
        (messages.Bye(reason="stopped"), ProtocolError),
        (messages.Moved(episode="e1", port=1, url="ws://evil.example"), StrangerError),
    ],
)
def test_hello_may_be_refused(answer: messages.ServerMessage, kind: type[Exception]) -> None:
    client = new()
    client.connection_made(0.0)
    client.receive(answer, 0.0)
    assert client.state is ClientState.CLOSED
    assert type(client.error) is kind


def test_hello_without_an_answer_is_given_up() -> None:
    client = new()
    client.connection_made(0.0)
    assert client.get_timer() == 15.0
    client.handle_timer(15.0)
    assert client.state is ClientState.CLOSED
    assert "did not welcome us" in client.farewell


def test_hello_is_not_sent_round_and_round(server: ScriptedServer) -> None:
    client = new()
    for port in range(9001, 9005):
        assert client.state in (ClientState.OFFLINE, ClientState.MOVING)
        client.connection_made(0.0)
        client.receive(server.moved(port=port), 0.0)
        assert client.url == f"ws://127.0.0.1:{port}"
    assert client.state is ClientState.CLOSED
    assert "from one process to the next" in client.farewell


def test_a_join_goes_where_it_is_sent(server: ScriptedServer) -> None:
    client = in_lobby(server, reconnect=False)
    ref = client.request(JOIN, 0.0)
    (join,) = sent(client)
    client.receive(server.moved(ref), 0.0)
    assert (client.state, client.url) == (ClientState.MOVING, "ws://127.0.0.1:9000")
    assert 0.1 <= client.connect_at <= 0.2
    client.connection_made(0.2)
    (hello,) = sent(client)
    assert isinstance(hello, messages.Hello)
    assert hello.resume is None
    client.receive(server.welcome(), 0.2)
    assert sent(client) == [join]


def test_a_join_is_not_sent_round_and_round(server: ScriptedServer) -> None:
    client = in_lobby(server)
    ref = client.request(JOIN, 0.0)
    for _ in range(3):
        client.receive(server.moved(ref), 0.0)
        client.connection_made(0.0)
        client.receive(server.welcome(), 0.0)
    client.receive(server.moved(ref), 0.0)
    assert "from one process to the next" in str(failure(client))
    assert client.state is ClientState.LOBBY


def test_a_join_that_is_sent_to_strangers_fails_alone(server: ScriptedServer) -> None:
    client = in_lobby(server)
    ref = client.request(JOIN, 0.0)
    client.receive(server.moved(ref, url="ws://evil.example"), 0.0)
    assert isinstance(failure(client), StrangerError)
    assert (client.state, client.url) == (ClientState.LOBBY, URL)


def test_a_request_is_repeated_where_the_server_asks_for_it(server: ScriptedServer) -> None:
    client = in_lobby(server)
    ref = client.request(JOIN, 0.0)
    (join,) = sent(client)
    client.receive(server.error("server/handover", ref), 1.0)
    client.handle_timer(1.5)
    assert sent(client) == [join]
    client.receive(server.error("episode/full", ref), 2.0)
    assert str(failure(client)) == "episode/full: no"


def test_only_time_with_a_connection_counts_for_an_answer(server: ScriptedServer) -> None:
    client = in_lobby(server)
    client.request(JOIN, 0.0)
    client.connection_lost(10.0)
    client.connection_made(14.0)
    client.receive(server.welcome(), 14.0)
    client.handle_timer(15.0)
    assert client.events() == []
    client.handle_timer(30.0)
    assert "does not answer" in str(failure(client))


@pytest.mark.parametrize("code", [CODE, CODE.replace("-", "").lower(), "e1"])
def test_who_is_in_the_episode_already_has_joined(server: ScriptedServer, code: str) -> None:
    """A resume token of another process brought us in before we asked."""
    client = new(resume="old")
    client.connection_made(0.0)
    client.receive(server.welcome(resumed=True), 0.0)
    client.receive(server.joined(), 0.0)
    client.receive(server.snapshot(), 0.0)
    ref = client.request(messages.Join(episode=code), 0.0)
    client.receive(server.error("episode/joined", ref), 0.0)
    (event,) = client.events()
    assert isinstance(event, RequestDone)


def test_who_has_left_already_has_left(server: ScriptedServer) -> None:
    client = playing(server)
    ref = client.request(messages.Leave(), 0.0)
    client.receive(server.error("episode/none", ref), 0.0)
    assert [event.ref for event in client.events()] == [ref]
    assert client.game is None


def test_a_bye_with_retry_is_no_end_and_one_without_is(server: ScriptedServer) -> None:
    client = playing(server)
    game = client.game
    assert game is not None
    client.receive(messages.Bye(reason="restart", retry=True), 0.0)
    assert (client.state, game.ended) == (ClientState.PLAYING, False)
    ref = client.request(messages.ListEpisodes(), 0.0)
    client.receive(messages.Bye(reason="elsewhere", code="session/elsewhere"), 0.0)
    assert (client.state, client.farewell) == (ClientState.CLOSED, "elsewhere")
    assert game.poll()[-1] == Over({}, "elsewhere", "session/elsewhere")
    assert [event.ref for event in client.events()] == [ref]


def test_what_cannot_be_applied_is_raised_and_the_shell_gives_up(server: ScriptedServer) -> None:
    client = playing(server)
    with pytest.raises(ProtocolError, match="another hash") as caught:
        client.receive(server.snapshot(hash="0" * 16), 0.0)
    client.fail(caught.value)
    assert client.farewell.startswith("the server's messages cannot be read: state/mismatch")


def test_an_answer_that_nobody_waits_for_is_dropped(server: ScriptedServer) -> None:
    client = in_lobby(server)
    ref = client.request(messages.ListEpisodes(), 0.0)
    client.forget(ref)
    client.receive(messages.Episodes(ref=ref, episodes=[]), 0.0)
    assert client.events() == []


def test_an_action_is_sent_again_in_time_but_only_on_a_good_line(server: ScriptedServer) -> None:
    client = playing(server)
    assert client.game is not None
    assert client.get_timer() is None
    client.game.propose(None, 1.0)
    (act,) = sent(client)
    assert client.get_timer() == 6.0
    client.connection_lost(2.0)
    assert client.get_timer() is None
    come = 5.0
    client.connection_made(come)
    client.receive(server.welcome(resumed=True), come)
    client.receive(server.joined(), come)
    sent(client)
    assert client.get_timer() == 10.0
    client.handle_timer(10.0)
    assert sent(client) == [act]


def test_who_was_forgotten_asks_for_all_of_its_seats_again(server: ScriptedServer) -> None:
    client = in_lobby(server)
    ref = client.request(JOIN.model_copy(update={"seats": "all"}), 0.0)
    sent(client)
    client.receive(server.joined(ref, seats=["robot1", "robot2"]), 0.0)
    client.receive(server.snapshot(), 0.0)
    come_back(client, server, resumed=False, now=1.0)
    (join,) = sent(client)
    assert isinstance(join, messages.Join)
    assert (join.seat, join.seats) == (None, ["robot1", "robot2"])


def test_a_game_in_words_begins_when_each_seat_was_told(server: ScriptedServer) -> None:
    client = in_lobby(server)
    ref = client.request(JOIN.model_copy(update={"seats": "all", "view": "text"}), 0.0)
    client.receive(server.joined(ref, seats=["robot1", "robot2"]), 0.0)
    client.receive(server.observation(seat="robot1"), 0.0)
    assert client.events() == []
    client.receive(server.observation(seat="robot2"), 0.0)
    assert [event.ref for event in client.events()] == [ref]


def test_who_came_by_a_token_alone_and_was_forgotten_asks_for_the_same_view(
    server: ScriptedServer,
) -> None:
    tellings = {
        "state": [server.snapshot()],
        "text": [server.observation()],
        "both": [server.snapshot(), server.observation()],
    }
    for view, telling in tellings.items():
        client = new(resume="a token")
        client.connection_made(0.0)
        sent(client)
        for message in (server.welcome(resumed=True), server.joined(), *telling):
            client.receive(message, 0.0)
        come_back(client, server, resumed=False, now=1.0)
        (join,) = sent(client)
        assert isinstance(join, messages.Join)
        assert (join.seats, join.seat, join.view) == ([], "robot1", view)
