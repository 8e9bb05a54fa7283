"""A server of several nodes: clients without sockets and clock."""

from __future__ import annotations

import random
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import ProtocolError
from robotouille.protocol import messages
from robotouille_client.errors import ConnectionFailedError, RetryLaterError, UntrustedRedirectError
from robotouille_client.sansio.addresses import moved_url
from robotouille_client.sansio.client_protocol import ClientProtocol
from robotouille_client.sansio.client_state import ClientState, RequestDone, RequestFailed
from robotouille_client.sansio.game_replica import GameReplica
from tests.support.scripted_server import CODE, ScriptedServer

Protocol = ClientProtocol[GameReplica]
A, B, C = (f"wss://node{n}.kitchen.lab.org" for n in "123")
DOWN = ConnectionFailedError("nobody there")


@pytest.fixture
def server() -> ScriptedServer:
    return ScriptedServer()


def new(url: str = A, **options: object) -> Protocol:
    options = {"url": url, "name": "ada", "rng": random.Random(1), **options}
    return ClientProtocol(GameReplica, **options)  # type: ignore[arg-type]


def sent(client: Protocol) -> list[messages.Message]:
    """Send and return all queued messages."""
    found = []
    while (message := client.next_message()) is not None:
        found.append(message)
        client.message_sent()
    return found


def greet(
    client: Protocol, server: ScriptedServer, *nodes: str, resumed: bool = False, now: float = 0.0
) -> messages.Hello:
    """Connect, welcome the client with these nodes, and return its hello."""
    client.connection_made(now)
    (hello,) = sent(client)
    assert isinstance(hello, messages.Hello)
    welcome = server.welcome(resumed=resumed)
    client.receive(welcome.model_copy(update={"nodes": list(nodes)}), now)
    return hello


def playing(server: ScriptedServer, *nodes: str, **options: object) -> Protocol:
    client = new(**options)  # type: ignore[arg-type]
    greet(client, server, *nodes)
    ref = client.request(messages.Join(episode=CODE), 0.0)
    sent(client)
    client.receive(server.joined(ref), 0.0)
    client.receive(server.snapshot(), 0.0)
    client.events()
    return client


def fail_round(client: Protocol, now: float, count: int) -> list[str]:
    """Fail attempts that follow each other without a delay, and return their addresses."""
    tried = []
    for _ in range(count):
        tried.append(client.url)
        client.connection_failed(DOWN, now)
        if client.connect_at > now:
            break
    return tried


# Lost nodes


def test_client_of_a_lost_node_tries_all_nodes_within_a_second(server: ScriptedServer) -> None:
    client = playing(server, B, C)
    client.connection_lost(10.0)
    assert client.url == A
    assert 10.1 <= client.connect_at <= 10.2
    tried = fail_round(client, now := client.connect_at, 9)
    assert (tried[0], sorted(tried)) == (A, [A, B, C])
    assert 0.15 <= client.connect_at - now <= 0.3


def test_client_stays_at_the_node_that_welcomes_it(server: ScriptedServer) -> None:
    client = playing(server, B, C)
    game = client.game
    client.connection_lost(10.0)
    fail_round(client, client.connect_at, 1)
    chosen = client.url
    hello = greet(client, server, A, resumed=True, now=10.2)
    assert (chosen != A, hello.resume) == (True, "resume-1")
    client.receive(server.joined(), 10.2)
    assert (client.state, client.game) == (ClientState.PLAYING, game)
    client.connection_lost(20.0)
    assert client.url == chosen
    assert client.connect_at <= 20.2


def test_nodes_of_the_last_welcome_replace_the_earlier_ones(server: ScriptedServer) -> None:
    client = playing(server, B)
    client.connection_lost(10.0)
    greet(client, server, C, resumed=True, now=11.0)
    client.connection_lost(12.0)
    assert sorted(fail_round(client, client.connect_at, 9)) == [A, C]


def test_clients_of_one_node_spread_over_the_others(server: ScriptedServer) -> None:
    chosen = set()
    for seed in range(20):
        client = playing(server, B, C, rng=random.Random(seed))
        client.connection_lost(10.0)
        fail_round(client, client.connect_at, 1)
        chosen.add(client.url)
    assert chosen == {B, C}


def test_delays_grow_from_round_to_round(server: ScriptedServer) -> None:
    client = playing(server, B, C)
    client.connection_lost(0.0)
    begins = [0.0, client.connect_at]
    for _ in range(10):
        fail_round(client, client.connect_at, 9)
        begins.append(client.connect_at)
    waits = [after - before for before, after in pairwise(begins)]
    for number, wait in enumerate(waits):
        longest = min(0.2 * 1.5**number, 1.5)
        assert longest / 2 <= wait <= longest + 1e-9


def test_silent_nodes_hold_up_only_clients_that_know_no_other(server: ScriptedServer) -> None:
    alone, one_of_three = playing(server), playing(server, B, C)
    for client in (alone, one_of_three):
        client.connection_lost(0.0)
    assert alone.addresses.connect_seconds == 10
    limits = []
    for _ in range(6):
        limits.append(one_of_three.addresses.connect_seconds)
        fail_round(one_of_three, one_of_three.connect_at, 9)
    assert limits == [2, 4, 6, 8, 10, 10]


@pytest.mark.parametrize(
    "answer",
    [
        messages.Error(code="server/handover", message="soon"),
        messages.Bye(reason="draining", code="server/draining", retry=True),
    ],
)
def test_node_that_is_not_ready_sends_the_client_to_the_next(
    server: ScriptedServer, answer: messages.ServerMessage
) -> None:
    client = playing(server, B)
    client.connection_lost(10.0)
    for url in (A, B):
        assert client.url == url
        client.connection_made(11.0)
        client.receive(answer, 11.0)
    assert 11.15 <= client.connect_at <= 11.3
    assert greet(client, server, resumed=True, now=12.0).resume == "resume-1"


def test_client_of_a_single_server_tries_only_the_process_of_its_episode(
    server: ScriptedServer,
) -> None:
    client = new("ws://127.0.0.1:8765")
    greet(client, server)
    ref = client.request(messages.Join(episode=CODE), 0.0)
    client.receive(server.moved(ref), 0.0)
    greet(client, server)
    client.connection_lost(5.0)
    for _ in range(5):
        assert client.url == "ws://127.0.0.1:9000"
        client.connection_failed(DOWN, 6.0)
        assert client.connect_at > 6.0


# Moves


def test_episode_that_moves_is_resumed_at_its_new_node_at_once(server: ScriptedServer) -> None:
    client = playing(server, B)
    game = client.game
    assert game is not None
    seq = game.propose(None, 5.0)
    client.request(messages.ListEpisodes(), 5.0)
    listing, act = sent(client)
    client.receive(server.moved(url=C), 5.0)
    assert (client.state, client.url, client.connect_at) == (ClientState.MOVING, C, 5.0)
    hello = greet(client, server, A, B, resumed=True, now=5.0)
    assert (hello.resume, hello.seen) == ("resume-1", messages.Seen(episode="e1"))
    assert sent(client) == [listing]
    client.receive(server.joined(), 5.0)
    assert sent(client) == [act]
    assert (client.game, game.propose(None, 5.0)) == (game, seq + 1)


def test_move_to_a_node_that_has_stopped_leads_to_the_others(server: ScriptedServer) -> None:
    client = playing(server, B)
    client.receive(server.moved(url=C), 5.0)
    assert sorted(fail_round(client, 5.0, 9)) == [A, B, C]
    assert client.connect_at > 5.0


def test_nodes_that_move_an_episode_in_a_circle_cannot_hurry_a_client(
    server: ScriptedServer,
) -> None:
    client = playing(server, B)
    now = 5.0
    for url in (B, A, B, A):
        client.receive(server.moved(url=url), now)
        if now > 5.0:
            assert client.connect_at >= now + 0.1
        now = client.connect_at
        greet(client, server, resumed=True, now=now)
        client.receive(server.joined(), now)


def test_move_to_an_untrusted_address_ends_the_game(server: ScriptedServer) -> None:
    client = playing(server)
    client.receive(server.moved(url="wss://evil.example"), 5.0)
    assert client.state is ClientState.CLOSED
    assert isinstance(client.error, UntrustedRedirectError)
    assert "name its address in --url too" in client.farewell


def test_move_before_the_join_is_complete_leaves_the_join_pending(server: ScriptedServer) -> None:
    client = new()
    greet(client, server, B)
    ref = client.request(messages.Join(episode=CODE), 0.0)
    sent(client)
    client.receive(server.joined(ref), 0.0)
    client.receive(server.moved(url=B), 2.0)
    greet(client, server, resumed=True, now=2.0)
    client.receive(server.joined(), 2.0)
    client.receive(server.snapshot(), 2.0)
    (event,) = client.events()
    assert isinstance(event, RequestDone)


def test_redirected_hello_keeps_the_resume_token(server: ScriptedServer) -> None:
    client = playing(server, B)
    client.connection_lost(5.0)
    client.connection_made(5.2)
    client.receive(server.moved(url=C), 5.2)
    assert (client.url, client.connect_at) == (C, 5.2)
    assert greet(client, server, resumed=True, now=5.2).resume == "resume-1"


def test_redirect_to_the_lost_node_is_not_followed_twice_in_a_round(
    server: ScriptedServer,
) -> None:
    # The living nodes redirect to the lost one until another node has taken the episode over.
    client = playing(server, B, C)
    client.connection_lost(5.0)
    client.connection_failed(DOWN, 5.2)
    asked = []
    while client.connect_at <= 5.2:
        asked.append(client.url)
        client.connection_made(5.2)
        client.receive(server.moved(url=A), 5.2)
    assert sorted(asked) == [B, C]
    assert client.connect_at <= 5.6


def test_join_waits_until_another_node_has_the_episode_of_a_lost_one(
    server: ScriptedServer,
) -> None:
    client = new(f"{A},{B}")
    greet(client, server)
    here = client.url
    there = B if here == A else A
    ref = client.request(messages.Join(episode=CODE), 0.0)
    delays = []
    for _ in range(18):
        now = client.connect_at
        client.receive(server.moved(ref, url=there), now)
        delays.append(client.connect_at - now)
        client.connection_failed(DOWN, client.connect_at)
        assert client.url == here
        greet(client, server, now=client.connect_at)
    assert client.events() == []
    assert max(delays[:3]) < min(delays[5:])
    assert min(delays[16:]) >= 2.5
    client.receive(server.joined(ref), 60.0)
    client.receive(server.snapshot(), 60.0)
    assert [event.ref for event in client.events()] == [ref]
    client.connection_lost(70.0)
    assert client.connect_at <= 70.2


# Addresses


def test_named_addresses_are_tried_in_random_order() -> None:
    orders = set()
    for seed in range(60):
        client = new(f"{A}, {B},{C},{A}", rng=random.Random(seed))
        orders.add(tuple(fail_round(client, 0.0, 9)))
        assert client.state is ClientState.CLOSED
    assert len(orders) == 6


def test_first_connection_fails_when_no_named_node_answers() -> None:
    client = new(f"{A},{B}")
    for text in ("nobody at 1", "nobody at 2"):
        assert client.connect_at == 0.0
        client.connection_failed(ConnectionFailedError(text), 0.0)
    assert str(client.error) == "nobody at 1; nobody at 2"


def test_first_connection_may_be_tried_later_if_one_node_is_not_ready() -> None:
    client = new(f"{A},{B}")
    client.connection_made(0.0)
    client.receive(messages.Bye(reason="draining", retry=True), 0.0)
    client.connection_failed(DOWN, 0.0)
    assert type(client.error) is RetryLaterError


def test_refusal_of_one_node_counts_for_all() -> None:
    client = new(f"{A},{B}")
    client.connection_made(0.0)
    client.receive(messages.Error(code="auth/required", message="a token"), 0.0)
    assert isinstance(client.error, ProtocolError)


UNTRUSTED = [
    "wss://evil.example",
    "wss://node2.kitchen.lab.org.evil.example",
    "wss://kitchen.lab.org",
    "wss://evil.lab.org",
    "wss://kitchen.lab.org@evil.example",
    "ws://node1.kitchen.lab.org",
    "ws://node2.kitchen.lab.org",
    "https://node2.kitchen.lab.org",
    "wss://[",
    "nonsense",
]


def test_untrusted_nodes_are_ignored(server: ScriptedServer) -> None:
    client = playing(server, *UNTRUSTED, B)
    client.connection_lost(5.0)
    assert fail_round(client, client.connect_at, 99) == [A, B]


@pytest.mark.parametrize("url", UNTRUSTED)
def test_join_is_not_redirected_to_an_untrusted_address(server: ScriptedServer, url: str) -> None:
    client = new()
    greet(client, server, B)
    ref = client.request(messages.Join(episode=CODE), 0.0)
    client.receive(server.moved(ref, url=url), 0.0)
    (event,) = client.events()
    assert isinstance(event, RequestFailed)
    assert isinstance(event.error, UntrustedRedirectError)
    assert (client.url, client.resume) == (A, "resume-1")


@pytest.mark.parametrize(
    ("here", "there"),
    [
        ("wss://node1.kitchen.lab.org", "wss://node2.kitchen.lab.org:8766/x"),
        ("wss://lab.org", "wss://node1.lab.org"),
        ("wss://node1.lab.org", "wss://node2.lab.org"),
        ("wss://a.kitchens.co.uk", "wss://b.kitchens.co.uk"),
    ],
)
def test_redirect_within_a_domain_is_followed(here: str, there: str) -> None:
    assert moved_url(here, messages.Moved(episode="x", port=1, url=there)) == there


@pytest.mark.parametrize(
    ("here", "there"),
    [
        ("ws://node1.kitchen.lab.org", "ws://node2.kitchen.lab.org"),
        ("ws://node1.kitchen.lab.org", "wss://node2.kitchen.lab.org"),
        ("wss://kitchen.org", "wss://evil.org"),
        ("wss://kitchen.org.", "wss://evil.org."),
        ("wss://kitchen.co.uk", "wss://evil.co.uk"),
        ("wss://10.0.0.1", "wss://11.0.0.1"),
        ("wss://10.0.0.1", "wss://x.10.0.0.1"),
        ("wss://a.kitchen.lab.org", "wss://kitchen.lab.org"),
        ("wss://localhost", "wss://evil.localhost"),
    ],
)
def test_redirect_to_another_host_is_refused(here: str, there: str) -> None:
    with pytest.raises(UntrustedRedirectError, match="another host"):
        moved_url(here, messages.Moved(episode="x", port=1, url=there))


@pytest.mark.parametrize(
    ("here", "there"),
    [
        ("ws://10.0.0.1:8765", "ws://10.0.0.2:9000"),
        ("ws://10.0.0.1:8765", "wss://10.0.0.2"),
        ("wss://a.example", "wss://10.0.0.2"),
    ],
)
def test_redirect_to_a_named_host_is_followed(here: str, there: str) -> None:
    moved = messages.Moved(episode="x", port=1, url=there)
    assert moved_url(here, moved, [here, "ws://10.0.0.2:8765"]) == there


LABELS = st.sampled_from(["a", "b", "lab", "org", "co", "uk", "1", "10", ""])
HOSTS = st.lists(LABELS, min_size=1, max_size=5).map(".".join).filter(lambda host: host.strip("."))


@given(st.lists(HOSTS, min_size=2, max_size=6))
def test_no_chain_of_redirects_leaves_the_domain(hosts: list[str]) -> None:
    start = here = hosts[0]
    for host in hosts[1:]:
        moved = messages.Moved(episode="x", port=1, url=f"wss://{host}")
        try:
            moved_url(f"wss://{here}", moved)
        except UntrustedRedirectError:
            continue
        here = host
    parent = start.partition(".")[2]
    assert here == start or here.endswith((f".{start}", f".{parent}"))
    if here != start and not here.endswith(f".{start}"):
        assert len(parent.split(".")) >= 2


EVENTS = st.lists(st.sampled_from(["fail", "lose", "welcome", "move", "handover"]), max_size=40)


@pytest.mark.slow
@given(seed=st.integers(0, 2**32), events=EVENTS)
def test_no_order_of_failures_forgets_a_node_or_hurries_the_client(
    seed: int, events: list[str]
) -> None:
    server = ScriptedServer()
    client = playing(server, B, C, rng=random.Random(seed))
    now = 10.0
    for event in events:
        now = max(now + 2.0, client.connect_at)
        online = client.state.online
        match event:
            case "fail" if not online:
                client.connection_failed(DOWN, now)
            case "lose" if online:
                client.connection_lost(now)
            case "welcome" if not online:
                others = [url for url in (A, B, C) if url != client.url]
                greet(client, server, *others, resumed=True, now=now)
                client.receive(server.joined(), now)
            case "move" if online:
                client.receive(server.moved(url=random.Random(seed).choice([A, B, C])), now)
            case "handover" if not online:
                client.connection_made(now)
                client.receive(messages.Error(code="server/handover", message="soon"), now)
            case _:
                pass
    if client.state.online:
        client.connection_lost(now)
    # The rest of this round, and the next one, which is complete.
    fail_round(client, now := client.connect_at, 9)
    assert client.connect_at > now
    assert sorted(fail_round(client, client.connect_at, 9)) == [A, B, C]
    assert client.resume is not None
