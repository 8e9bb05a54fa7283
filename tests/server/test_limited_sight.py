"""Episodes whose players see a part of the kitchen: nothing else reaches their clients."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Mapping
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille import Sight, State, UnknownNameError, World
from robotouille.episode import ActionRejected, ActionRequest, Clock, Episode, Rules, Stepped
from robotouille.protocol.states import StateReader, StateWriter
from robotouille.replay.recording import Recording, read_recording
from robotouille.world.sight import HIDDEN_REASON, Seen, seen_by
from robotouille_server.auth import Role
from robotouille_server.rooms.publishing.episode_messages import EpisodeMessages
from robotouille_server.rooms.publishing.limited_sight import LimitedSight
from tests.support.handshakes import hello, mint_token, opened
from tests.support.lost_connections import cut
from tests.support.samples import quick_sample
from tests.support.servers import Raw, crash, raw, serving, with_clients
from tests.support.virtual_time import virtual

WITHOUT_STATE = {"welcome", "joined", "said", "notice", "told", "left", "error"}
"""Messages that contain nothing about the kitchen, apart from what participants wrote."""
STATE_FIELDS = ("facts", "timers", "busy", "orders")
TABLES = ("predicates", "objects", "atoms")


class Audit:
    """Checks what one participant receives against the states in the recording."""

    def __init__(self, states: Mapping[int, State], seats: tuple[str, ...], sight: Sight) -> None:
        self.states, self.seats, self.sight = states, seats, sight
        self.world = states[0].world
        self.reader: StateReader | None = None
        self.hidden: list[str] = []
        self.step = 0
        self.seen_steps = 0

    def seen(self, step: int, *seats: str) -> Seen:
        return seen_by(self.states[step], seats or self.seats, self.sight)

    def check(self, message: dict[str, Any]) -> None:
        kind = message["type"]
        if kind not in WITHOUT_STATE:
            getattr(self, f"check_{kind}")(message)

    def check_snapshot(self, message: dict[str, Any]) -> None:
        tables = {name: message[name] for name in TABLES}
        values = {name: message[name] for name in STATE_FIELDS if name in message}
        self.reader = StateReader(self.world, tables, values)
        self.step, self.hidden = message["step"], message["hidden"]
        assert message["hash"] == self.seen(self.step).state.digest
        self.check_state()
        self.check_seats(message)
        for answer in (message, *message.get("answers", ())):
            self.check_reasons(answer.get("last_reasons", ()) or answer.get("reasons", ()))

    def check_state(self) -> None:
        assert self.reader is not None
        seen, found = self.seen(self.step), self.reader.state
        assert found.facts == seen.state.facts
        assert dict(found.timers.entries) == dict(seen.state.timers.entries)
        assert (found.timers.busy, found.orders) == (seen.state.timers.busy, seen.state.orders)
        assert self.hidden == list(seen.hidden)
        assert set(seen.hidden) == {t.name for t in self.states[self.step].objects} - seen.things

    def check_delta(self, message: dict[str, Any]) -> None:
        assert self.reader is not None
        if message["step"] <= self.step:  # A snapshot came before it.
            return
        assert message["step"] == self.step + 1 and "hash" not in message
        before, self.step = self.seen(self.step), message["step"]
        after = self.seen(self.step)
        self.reader.apply(message)
        self.hidden = message.get("hidden", self.hidden)
        self.check_state()
        throughout = before.things & after.things
        others = 0
        for number, (seat, _, *arguments) in enumerate(message.get("did", ())):
            player = self.world.players[seat]
            others += player not in self.seats
            assert player in self.seats or throughout.issuperset((player, *arguments))
            for why in message.get("why", {}).get(str(number), ()):
                assert why["kind"] != "condition" or throughout.issuperset(why["objects"])
            self.check_reasons(message.get("unmet", {}).get(str(number), ()), throughout)
        for seat in message.get("waits", ()):
            assert self.world.players[seat] in {*self.seats, *throughout}
        if before == after and "did" not in message and "waits" not in message:
            assert message.keys() <= {"type", "step", "turn", "orders"}
            self.seen_steps += 1

    def check_observation(self, message: dict[str, Any]) -> None:
        seen = self.seen(message["step"], message["seat"])
        assert message["text"] == seen.text_view(message["seat"])
        assert message["actions"] == [action.sentence for action in seen.actions]
        self.check_reasons(message.get("reasons", ()))

    def check_rejected(self, message: dict[str, Any]) -> None:
        seat = message.get("seat", self.seats[0])
        # A client with the view `text` learns from this message that its action failed in a step.
        states = [self.seen(at, seat) for at in (message["step"], max(0, message["step"] - 1))]
        for why in message.get("why", ()):
            if why["kind"] == "condition":
                atom = (why["predicate"], *why["objects"])
                assert any(self.is_sure(seen, atom) for seen in states), message
        if message.get("code") == "action/unknown":
            self.check_suggestions(message, states)

    def is_sure(self, seen: Seen, atom: tuple[str, ...]) -> bool:
        """Return whether all states with this seen part agree about a fact."""
        layout = self.world.task.domain.layout or ()
        when = next((rule.when for rule in layout if rule.predicate == atom[0]), None)
        if when in ("shares_tile", "bottom_of_stack", "next_in_stack"):
            return not seen.things.isdisjoint(atom[1:])
        own = when == "faces" and atom[1] in seen.players
        return (
            own
            or atom[0] in self.world.table.static_predicates
            or (seen.things.issuperset(atom[1:]))
        )

    def check_suggestions(self, message: dict[str, Any], states: list[Seen]) -> None:
        """Check that suggestions are made from the actions that seem valid."""
        expected = []
        for seen in states:
            with pytest.raises(UnknownNameError) as caught:
                self.world.named(message["action"], seen.actions)
            expected.append(str(caught.value))
        assert message["reasons"][0] in expected

    def check_reasons(self, reasons: Any, things: frozenset[str] | None = None) -> None:
        """Check that conditions are about things in sight."""
        if things is None:
            things = frozenset().union(*(self.seen(step).things for step in self.states))
        for reason in reasons:
            if reason.startswith(("needs: ", "must not be: ")):
                named = set(reason.replace(".", " ").split()) & set(self.world.thing_names)
                assert named <= things, reason

    def check_roster(self, message: dict[str, Any]) -> None:
        self.check_seats(message)

    def check_seats(self, message: dict[str, Any]) -> None:
        for seat in message["seats"]:
            assert seat["player"] in self.seats or not {"acted", "rejected"} & seat.keys()

    def check_ended(self, message: dict[str, Any]) -> None:
        assert message["hash"] == ""


class Chaos:
    """Random requests of one participant: valid, invalid, unreadable, and other messages."""

    def __init__(self, socket: Raw, world: World, seats: tuple[str, ...], seed: int) -> None:
        self.socket, self.world, self.seats = socket, world, seats
        self.rng = random.Random(seed)
        self.got: list[dict[str, Any]] = []
        self.offered: dict[str, dict[str, Any]] = {}
        self.seq = 0
        self.ended = asyncio.Event()

    async def listen(self) -> None:
        while not self.ended.is_set():
            message = await self.socket.receive()
            self.got.append(message)
            if message["type"] == "observation":
                self.offered[message.get("seat", "")] = message
            if message["type"] == "ended":
                self.ended.set()

    async def act(self) -> None:
        seat = self.rng.choice(self.seats)
        offered = self.offered.get(seat, {"actions": [], "step": 0})
        self.seq += 1
        act: dict[str, Any] = {"type": "act", "seq": self.seq}
        if len(self.seats) > 1:
            act["seat"] = seat
        match self.rng.randrange(10):
            case 0:
                misspelt = self.rng.choice(offered["actions"] or ["Do something"])
                act["action"] = f"{misspelt[:-2]}x{misspelt[-1:]}"
            case 1:
                action = self.rng.choice(self.known())
                act["action"] = {"name": action.name, "args": list(action.arguments)}
                act["anticipates"] = self.rng.random() < 0.5
            case 2:
                act |= {"action": None, "waits": True}
            case 3 if offered["actions"]:
                act |= {"basis": offered["step"]}
                act["action"] = self.rng.randrange(len(offered["actions"]))
            case _:
                act["action"] = self.rng.choice(offered["actions"] or [None])
        await self.socket.send(act)
        if self.rng.random() < 0.1:
            target = self.rng.choice(sorted(self.world.thing_names))
            other = {"seat": seat} if len(self.seats) > 1 else {}
            extra = [{"type": "resync"}, {"type": "signal", "intent": "look", "target": target}]
            await self.socket.send(
                {**(each := self.rng.choice(extra)), **(other if each["type"] == "signal" else {})}
            )

    def known(self) -> list[Any]:
        """Actions of the player's own robots, most of them not valid."""
        state = self.world.initial
        return [action for seat in self.seats for action in seen_by(state, seat, Sight(1)).actions]


async def chaos(
    folder: Path, create: dict[str, Any], parties: list[tuple[str, ...]], seed: int
) -> tuple[list[Chaos], list[dict[str, Any]], Recording]:
    """Play an episode in which all participants send random requests.

    Returns:
        The participants, what a spectator received, and the recording.
    """
    async with serving(folder) as server, AsyncExitStack() as stack:
        sockets = [
            await stack.enter_async_context(raw(server, text=i % 2 == 0, name=f"p{i}"))
            for i in range(len(parties) + 1)
        ]
        created = await sockets[-1].ask({"type": "create", **create}, "created")
        join = {"type": "join", "episode": created["code"]}
        await sockets[-1].ask({**join, "role": "spectator", "view": "both"}, "joined")
        world = server.lobby.find(created["episode"]).world
        players = []
        for i, seats in enumerate(parties):
            party = Chaos(sockets[i], world, seats, seed + i)
            wanted = {"seats": list(seats)} if len(seats) > 1 else {"seat": seats[0]}
            view = ["both", "state", "text"][(seed + i) % 3] if len(parties) > 1 else "both"
            request = {**join, **wanted, "view": view, "partial": True}
            party.got.append(await party.socket.ask(request, "joined"))
            assert party.got[0]["type"] == "joined", party.got
            players.append(party)
        watcher = Chaos(sockets[-1], world, (), seed)
        tasks = [asyncio.create_task(each.listen()) for each in (*players, watcher)]
        while not players[0].ended.is_set():
            for party in players:
                await party.act()
            await asyncio.sleep(0.11)
        await asyncio.gather(*tasks)
    (path,) = folder.glob("*.rbt")
    return players, watcher.got, read_recording(path)


TASKS = quick_sample(
    [
        ("multi_agent/07@2", {"clock": "realtime", "timing": "people"}),
        ("shifts/04", {"clock": "realtime", "timing": "people", "step_rate": 20.0}),
        ("multi_agent/01@3", {"clock": "lockstep", "move_budget": 0.1}),
        ("multi_agent/10@4", {"clock": "realtime", "timing": "people"}),
        ("asynchronous/09", {"clock": "realtime", "timing": "people"}),
        ("shifts/06", {"clock": "realtime", "timing": "people"}),
        ("multi_agent/07@2", {"clock": "turn", "move_budget": 0.1}),
    ],
    2,
)


@pytest.mark.parametrize("seed", quick_sample(range(6), 1))
@pytest.mark.parametrize(("task", "options"), TASKS)
@virtual
async def test_nothing_out_of_sight_reaches_a_player(
    tmp_path: Path, task: str, options: dict[str, Any], seed: int
) -> None:
    distance, blocked = [(2, False), (3, True), (1, True)][seed % 3]
    create = {"task": task, "sight": distance, "sight_blocked": blocked, "max_steps": 25}
    seats = World(task).players
    parties: list[tuple[str, ...]] = [(seat,) for seat in seats]
    if len(seats) > 2 and seed % 2:
        parties = [seats[:2], *((seat,) for seat in seats[2:])]
    players, watched, recording = await chaos(tmp_path, {**create, **options}, parties, seed)
    assert recording.verify().ok
    assert recording.header["rules"]["sight"] == distance
    states = dict(recording.states())
    sight = Sight(distance, blocked)
    for party in players:
        audit = Audit(states, party.seats, sight)
        for message in party.got:
            audit.check(message)
        assert len(party.got) > 10
    whole = [message for message in watched if message["type"] in ("snapshot", "delta")]
    assert all("hidden" not in message for message in whole)
    assert next(m for m in watched if m["type"] == "ended")["hash"] == states[max(states)].digest


SEATS = {"task": "multi_agent/07@2", "sight": 2, "move_budget": 0.0}


@virtual
async def test_python_client_has_the_part_of_the_state_and_the_actions_that_seem_valid(
    tmp_path: Path,
) -> None:
    async with with_clients(tmp_path, "ada", "bob") as (server, ada, bob):
        code = (await ada.create(**SEATS)).code
        first = await ada.join(code, partial=True)
        second = await bob.join(code, view="text")
        for _ in range(3):
            state = server.lobby.find(code).episode.state
            seen = seen_by(state, "robot1", Sight(2))
            assert first.state.digest == seen.state.digest
            assert first.hidden == set(seen.hidden)
            assert (first.actions, first.text_view) == (seen.actions, seen.text_view("robot1"))
            there = first.actions[-2]
            await asyncio.gather(first.act(there), second.act(second.observation.actions[0]))
        assert not first.goal_reached


@virtual
async def test_reasons_out_of_sight_are_not_told_also_after_a_restart(tmp_path: Path) -> None:
    world = World("multi_agent/07@2")
    seen = seen_by(world.initial, "robot1", Sight(2))
    taken = next(a for a in seen.actions if not world.applicable(world.initial, a))
    join = {"type": "join", "seat": "robot1", "view": "both", "partial": True}
    act = {"type": "act", "seq": 1, "action": taken.sentence}
    async with serving(tmp_path) as server:
        async with raw(server) as ada, raw(server) as bob:
            create = {"type": "create", **SEATS, "absence": "wait"}
            code = (await ada.ask(create, "created"))["code"]
            await ada.ask({**join, "episode": code}, "joined")
            await bob.ask({**join, "episode": code, "seat": "robot2"}, "joined")
            await bob.send({"type": "act", "seq": 1, "action": None})
            delta = await ada.ask(act, "delta", "rejected")
            assert delta["unmet"] == {"0": [HIDDEN_REASON]}
            snapshot = await ada.ask({"type": "resync"}, "snapshot")
            assert snapshot["last_reasons"] == [HIDDEN_REASON]
        await crash(server)
    async with serving(tmp_path) as server:
        answers = [room.episode.seat("robot1").answer for room in server.lobby.rooms.values()]
        assert [answer.reasons for answer in answers] == [(HIDDEN_REASON,)]


@virtual
async def test_a_player_who_comes_back_gets_a_snapshot_of_its_part(tmp_path: Path) -> None:
    async with with_clients(tmp_path, "ada", "bob") as (server, ada, bob):
        code = (await ada.create(**SEATS)).code
        game = await ada.join(code, partial=True)
        other = await bob.join(code, partial=True)
        cut(ada)
        while other.step < 6:
            await other.act(other.actions[other.step % 2])
        await asyncio.sleep(3)
        assert ada.resumed and game.step == 6
        seen = seen_by(server.lobby.find(code).episode.state, "robot1", Sight(2))
        assert game.state.digest == seen.state.digest and game.hidden == set(seen.hidden)


@virtual
async def test_clients_that_do_not_know_partial_states_and_players_who_watch_are_refused(
    tmp_path: Path,
) -> None:
    async with serving(tmp_path) as server, raw(server) as host, opened(server) as ada:
        token = mint_token(server, Role.PLAYER)
        assert (await hello(ada, token=token))["role"] == "player"
        code = (await host.ask({"type": "create", **SEATS}, "created"))["code"]
        join = {"type": "join", "episode": code}
        for view in ("state", "both"):
            refused = await ada.ask({**join, "view": view}, "joined")
            assert (refused["code"], refused["field"]) == ("seat/partial", "partial")
        refused = await ada.ask({**join, "role": "spectator"}, "joined")
        assert (refused["code"], refused["field"]) == ("auth/role", "role")
        assert (await ada.ask({**join, "view": "text"}, "joined"))["type"] == "joined"
        assert (await host.ask({**join, "role": "spectator"}, "joined"))["type"] == "joined"


@pytest.mark.slow
def test_actions_of_others_are_shown_only_if_all_of_it_is_in_sight_before_and_after() -> None:
    world, sight, rng = World("multi_agent/07@2"), Sight(2), random.Random(4)
    episode = Episode(world, Rules(clock=Clock.LOCKSTEP, sight=2), 0.0)
    limited = LimitedSight(
        episode, sight, EpisodeMessages("id", episode, StateWriter(world), float)
    )
    for player in world.players:
        episode.join(player, player, "bot", 0.0)
    shown = left_out = 0
    for seq in range(1, 150):
        before = seen_by(episode.state, "robot1", sight).things
        for player in world.players:
            action = rng.choice(episode.offered_actions(player))
            episode.submit(player, ActionRequest(seq, action), 0.0)
        (step,) = (event for event in episode.events() if isinstance(event, Stepped))
        throughout = before & seen_by(step.state, "robot1", sight).things
        move = next(move for move in step.moves if move.player == "robot2")
        visible = throughout.issuperset(("robot2", *move.action.arguments))
        row = [1, move.action.name, *move.action.arguments]
        assert (row in limited.delta(step, ("robot1",))["did"]) == visible
        shown, left_out = shown + visible, left_out + (not visible)
        if episode.ended:
            break
    assert min(shown, left_out) > 5


def test_suggestions_include_actions_that_only_seem_valid() -> None:
    world = World("multi_agent/07@2")
    episode = Episode(world, Rules(clock=Clock.LOCKSTEP, sight=2), 0.0)
    for player in world.players:
        episode.join(player, player, "bot", 0.0)
    offered = episode.offered_actions("robot1")
    seeming = next(a for a in offered if not world.applicable(episode.state, a))
    episode.submit("robot1", ActionRequest(1, seeming.sentence[1:]), 0.0)
    (rejected,) = (e for e in episode.events() if isinstance(e, ActionRejected))
    assert seeming.sentence in rejected.reasons[0]
