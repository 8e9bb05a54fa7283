"""Client protocol without sockets and clock."""

from __future__ import annotations

import random

import pytest

from robotouille import ProtocolError
from robotouille.protocol import messages
from robotouille_client.errors import ConnectionFailedError, RetryLaterError, UntrustedRedirectError
from robotouille_client.sansio.client_protocol import MAX_BRIEF, SETTLED_SECONDS, ClientProtocol
from robotouille_client.sansio.client_state import ClientState, RequestDone, RequestFailed
from robotouille_client.sansio.game_events import GameEnded
from robotouille_client.sansio.game_replica import GameReplica
from tests.support.scripted_server import CODE, ScriptedServer

Protocol = ClientProtocol[GameReplica]
URL = "ws://127.0.0.1:8765"
JOIN = messages.Join(episode=CODE)


@pytest.fixture
def server() -> ScriptedServer:
    return ScriptedServer()


def new(**options: object) -> Protocol:
    options = {"url": URL, "name": "ada", **options}
    return ClientProtocol(GameReplica, **options)  # type: ignore[arg-type]


def sent(client: Protocol) -> list[messages.Message]:
    """Send and return all queued messages."""
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


def test_requests_wait_until_hello_is_answered(server: ScriptedServer) -> None:
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


def test_join_is_answered_by_its_first_snapshot(server: ScriptedServer) -> None:
    client = in_lobby(server)
    ref = client.request(JOIN, 0.0)
    client.receive(server.joined(ref, resume="seat"), 0.0)
    assert (client.events(), client.resume) == ([], "seat")
    client.receive(server.snapshot(), 0.0)
    assert [event.ref for event in client.events()] == [ref]
    assert client.membership is not None
    assert client.membership.episode == CODE


def test_unsent_message_goes_over_the_next_connection(server: ScriptedServer) -> None:
    client = playing(server)
    assert client.game is not None
    client.game.say("hello?")
    said = client.next_message()
    come_back(client, server, resumed=True, now=1.0)
    assert sent(client) == [said]


def test_requests_are_repeated_except_create(server: ScriptedServer) -> None:
    client = in_lobby(server)
    client.request(messages.Create(), 0.0)
    ref = client.request(messages.ListEpisodes(), 0.0)
    assert len(sent(client)) == 2
    come_back(client, server, resumed=True, now=1.0)
    assert sent(client) == [messages.ListEpisodes(ref=ref)]


def test_resumed_game_reports_what_it_has_seen_and_repeats_its_action(
    server: ScriptedServer,
) -> None:
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


def test_forgotten_client_takes_its_seat_again_without_the_action(server: ScriptedServer) -> None:
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
def test_rejoin_is_repeated_after_a_temporary_error(server: ScriptedServer, code: str) -> None:
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


def test_lost_seat_ends_the_game_but_not_the_connection(server: ScriptedServer) -> None:
    client = playing(server)
    game = client.game
    assert game is not None
    come_back(client, server, resumed=False, now=1.0)
    (join,) = sent(client)
    assert isinstance(join, messages.Join)
    client.receive(server.error("episode/full", join.ref), 1.0)
    assert game.poll()[-1] == GameEnded({}, "no", "episode/full")
    assert (client.state, client.membership) == (ClientState.LOBBY, None)


@pytest.mark.parametrize("code", ["auth/expired", "auth/invalid", "auth/required", "auth/revoked"])
def test_role_token_is_used_when_the_resume_token_is_invalid(
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


def test_reconnect_delays_grow_and_start_over_after_a_welcome(server: ScriptedServer) -> None:
    client = in_lobby(server)
    client.connection_lost(0.0)
    waits = [client.connect_at]
    for _ in range(4):
        client.connection_failed(ConnectionFailedError("no"), client.connect_at)
        waits.append(client.connect_at - sum(waits))
    for wait, longest in zip(waits, [0.2, 0.3, 0.45, 0.675, 1.0125], strict=True):
        assert longest / 2 <= wait <= longest
    client.connection_made(10.0)
    client.receive(server.welcome(resumed=True), 10.0)
    client.connection_lost(10.0)
    assert client.connect_at <= 10.2


def lose_at_once(client: Protocol, server: ScriptedServer, welcome: messages.Welcome) -> float:
    """Connect when the client wants to, and close at once; return the time between the two."""
    before = client.connect_at
    client.connection_made(before)
    client.receive(welcome, before)
    client.connection_lost(before)
    return client.connect_at - before


def test_client_gives_up_if_each_connection_is_closed_at_once(server: ScriptedServer) -> None:
    client = playing(server)
    client.connection_lost(0.0)
    waits = []
    while client.state is not ClientState.CLOSED:
        waits.append(lose_at_once(client, server, server.welcome(resumed=True)))
        assert len(waits) <= MAX_BRIEF
    assert max(waits[:4]) < 0.5
    assert sum(waits) > 60
    assert str(client.error) == (
        f"{URL} welcomed the client 50 times in a row and closed the connection at once"
    )


def test_client_does_not_give_up_while_connections_last(server: ScriptedServer) -> None:
    client = playing(server)
    for _ in range(2 * MAX_BRIEF):
        client.connection_lost(client.connect_at + SETTLED_SECONDS)
        client.connection_made(client.connect_at)
        client.receive(server.welcome(resumed=True), client.connect_at)
    assert client.state.online
    client.connection_lost(client.connect_at)
    for _ in range(MAX_BRIEF - 2):
        lose_at_once(client, server, server.welcome(resumed=True))
    client.connection_made(client.connect_at)
    client.receive(server.welcome(resumed=True), client.connect_at)
    began = client.connect_at
    client.connection_lost(began + SETTLED_SECONDS)
    assert lose_at_once(client, server, server.welcome(resumed=True)) < 0.5


def test_reconnect_delays_depend_on_the_given_source_only(server: ScriptedServer) -> None:
    def waits(seed: int) -> list[float]:
        client = in_lobby(server, rng=random.Random(seed))
        client.connection_lost(0.0)
        found = [client.connect_at]
        client.connection_made(1.0)
        client.receive(server.welcome(resumed=True), 1.0)
        client.connection_lost(1.0)
        return [*found, client.connect_at]

    before = random.getstate()
    assert waits(1) == waits(1) != waits(2)
    assert random.getstate() == before


def test_first_connection_is_attempted_once(server: ScriptedServer) -> None:
    client = new()
    client.connection_failed(ConnectionFailedError("nobody there"), 0.0)
    assert client.state is ClientState.CLOSED
    assert str(client.error) == "nobody there"
    with pytest.raises(ConnectionFailedError, match="nobody there"):
        client.request(JOIN, 0.0)


def test_lost_connection_closes_a_client_without_reconnect(server: ScriptedServer) -> None:
    client = playing(server, reconnect=False)
    assert client.game is not None
    client.connection_lost(1.0)
    assert client.state is ClientState.CLOSED
    assert client.farewell == "the connection was closed"
    assert isinstance(client.game.poll()[-1], GameEnded)


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        (messages.Error(code="server/handover", message="soon"), RetryLaterError),
        (messages.Bye(reason="full", retry=True), RetryLaterError),
        (messages.Left(episode="e1"), RetryLaterError),
        (messages.Error(code="auth/required", message="a token"), ProtocolError),
        (messages.Bye(reason="stopped"), ProtocolError),
        (messages.Moved(episode="e1", port=1, url="ws://evil.example"), UntrustedRedirectError),
    ],
)
def test_refused_hello_closes_the_client(
    answer: messages.ServerMessage, kind: type[Exception]
) -> None:
    client = new()
    client.connection_made(0.0)
    client.receive(answer, 0.0)
    assert client.state is ClientState.CLOSED
    assert type(client.error) is kind


def test_hello_follows_a_limited_number_of_redirects(server: ScriptedServer) -> None:
    client = new()
    for port in range(9001, 9005):
        assert client.state in (ClientState.OFFLINE, ClientState.MOVING)
        client.connection_made(0.0)
        client.receive(server.moved(port=port), 0.0)
        assert client.url == f"ws://127.0.0.1:{port}"
    assert client.state is ClientState.CLOSED
    assert "from one process to the next" in client.farewell


def test_join_follows_a_redirect(server: ScriptedServer) -> None:
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


def test_join_follows_a_limited_number_of_redirects(server: ScriptedServer) -> None:
    client = in_lobby(server)
    ref = client.request(JOIN, 0.0)
    for _ in range(3):
        client.receive(server.moved(ref), 0.0)
        client.connection_made(0.0)
        client.receive(server.welcome(), 0.0)
    client.receive(server.moved(ref), 0.0)
    assert "from one process to the next" in str(failure(client))
    assert client.state is ClientState.LOBBY


def test_untrusted_redirect_of_a_join_fails_only_the_join(server: ScriptedServer) -> None:
    client = in_lobby(server)
    ref = client.request(JOIN, 0.0)
    client.receive(server.moved(ref, url="ws://evil.example"), 0.0)
    assert isinstance(failure(client), UntrustedRedirectError)
    assert (client.state, client.url) == (ClientState.LOBBY, URL)


def test_untrusted_redirect_of_a_rejoin_closes_the_client(server: ScriptedServer) -> None:
    client = playing(server)
    come_back(client, server, resumed=False, now=1.0)
    (join,) = sent(client)
    assert isinstance(join, messages.Join)
    client.receive(server.moved(join.ref, url="ws://evil.example"), 1.0)
    assert (client.state, client.url) == (ClientState.CLOSED, URL)
    assert isinstance(client.error, UntrustedRedirectError)


def test_message_or_connection_in_the_wrong_state_is_an_error(server: ScriptedServer) -> None:
    client = in_lobby(server)
    for cause in (
        lambda: client.receive(server.welcome(), 0.0),
        lambda: client.connection_made(0.0),
    ):
        with pytest.raises(ProtocolError) as caught:
            cause()
        assert (caught.value.code, client.state) == ("message/unexpected", ClientState.LOBBY)


def test_request_is_repeated_during_a_handover(server: ScriptedServer) -> None:
    client = in_lobby(server)
    ref = client.request(JOIN, 0.0)
    (join,) = sent(client)
    client.receive(server.error("server/handover", ref), 1.0)
    client.handle_timer(1.5)
    assert sent(client) == [join]
    client.receive(server.error("episode/full", ref), 2.0)
    assert str(failure(client)) == "episode/full: no"


def test_request_timeout_counts_only_time_with_a_connection(server: ScriptedServer) -> None:
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
def test_join_of_the_current_episode_succeeds(server: ScriptedServer, code: str) -> None:
    """The resume token of another process has already entered the episode."""
    client = new(resume="old")
    client.connection_made(0.0)
    client.receive(server.welcome(resumed=True), 0.0)
    client.receive(server.joined(), 0.0)
    client.receive(server.snapshot(), 0.0)
    ref = client.request(messages.Join(episode=code), 0.0)
    client.receive(server.error("episode/joined", ref), 0.0)
    (event,) = client.events()
    assert isinstance(event, RequestDone)


def test_leave_without_an_episode_succeeds(server: ScriptedServer) -> None:
    client = playing(server)
    ref = client.request(messages.Leave(), 0.0)
    client.receive(server.error("episode/none", ref), 0.0)
    assert [event.ref for event in client.events()] == [ref]
    assert client.game is None


def test_only_a_bye_without_retry_closes_the_client(server: ScriptedServer) -> None:
    client = playing(server)
    game = client.game
    assert game is not None
    client.receive(messages.Bye(reason="restart", retry=True), 0.0)
    assert (client.state, game.ended) == (ClientState.PLAYING, False)
    ref = client.request(messages.ListEpisodes(), 0.0)
    client.receive(messages.Bye(reason="elsewhere", code="session/elsewhere"), 0.0)
    assert (client.state, client.farewell) == (ClientState.CLOSED, "elsewhere")
    assert game.poll()[-1] == GameEnded({}, "elsewhere", "session/elsewhere")
    assert [event.ref for event in client.events()] == [ref]


def test_inconsistent_snapshot_raises_and_fail_closes_the_client(server: ScriptedServer) -> None:
    client = playing(server)
    with pytest.raises(ProtocolError, match="hash does not match") as caught:
        client.receive(server.snapshot(hash="0" * 16), 0.0)
    client.fail(caught.value)
    assert client.farewell.startswith("invalid message from the server: state/mismatch")


def test_forgotten_client_asks_for_all_its_seats(server: ScriptedServer) -> None:
    client = in_lobby(server)
    ref = client.request(JOIN.model_copy(update={"seats": "all"}), 0.0)
    sent(client)
    client.receive(server.joined(ref, seats=["robot1", "robot2"]), 0.0)
    client.receive(server.snapshot(), 0.0)
    come_back(client, server, resumed=False, now=1.0)
    (join,) = sent(client)
    assert isinstance(join, messages.Join)
    assert (join.seat, join.seats) == (None, ["robot1", "robot2"])


def test_client_resumed_by_token_asks_for_the_same_view_when_forgotten(
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
