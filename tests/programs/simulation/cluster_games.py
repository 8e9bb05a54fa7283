"""Episodes of a simulated cluster, and players who look for them on one node after another."""

from __future__ import annotations

import asyncio
import random
from typing import TYPE_CHECKING, Any

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.auth import Role
from robotouille_server.cluster.bus import BusError
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.participants.sessions import Sessions
from robotouille_server.rooms.room import Room
from tests.programs.simulation.cluster_nodes import NodeMachine

if TYPE_CHECKING:
    from tests.programs.simulation.cluster import ClusterSimulation

__all__ = ["Game"]

TASKS = (("training/01_synchronous", 1), ("training/03_multi_agent@2", 2))
OPEN_SECONDS = 5.0
LOST_SECONDS = 1.5
"""Seconds without a sign of the episode after which a player tries another node."""
MAX_SPECTATORS = 10


class Game:
    """One episode, from the first attempt to open it to its end."""

    def __init__(self, sim: ClusterSimulation, tag: str) -> None:
        self.sim, self.tag = sim, tag
        self.id = self.code = ""
        chance = self._chance = random.Random(f"{sim.seed}/{tag}")
        self.task, seats = chance.choice(TASKS)
        clock = chance.choice(("realtime", "realtime", "turn", "lockstep"))
        self.options: dict[str, Any] = {"clock": clock, "max_steps": chance.randint(8, 25)}
        if clock == "realtime":
            self.options["step_rate"] = chance.choice((1.0, 2.0, 5.0))
        self.players = [Player(self, number) for number in range(seats)]

    @property
    def over(self) -> bool:
        """Return whether the end of the episode is recorded."""
        truth = self.sim.oracle.truths.get(self.id)
        return truth is not None and truth.outcome is not None

    @property
    def holders(self) -> list[NodeMachine]:
        """Nodes that continue the episode."""
        return [m for m in self.sim.machines if any(room.id == self.id for room in m.live)]

    async def run(self) -> None:
        """Open the episode at some node, and play."""
        while not self.id:
            machine = self._chance.choice(self.sim.machines)
            if machine.lobby is not None:
                machine.process.start(self._open(machine))
            await asyncio.sleep(OPEN_SECONDS)
        await asyncio.gather(*(player.play() for player in self.players))

    async def _open(self, machine: NodeMachine) -> None:
        node, lobby = machine.node, machine.lobby
        if node is None or lobby is None:
            return
        request = messages.Create(task=self.task, **self.options)
        try:
            room = lobby.create(request)
            await node.registered(room.id)
        except (BusError, ProtocolError) as error:
            self.sim.trace("not opened", machine.name, error)
            return
        if not self.id and not room.episode.ended:
            self.id, self.code = room.id, room.code
            self.sim.trace("opened", machine.name, self.id)
        else:
            room.abort("opened twice")


class Player:
    """Player who keeps one session on all nodes, as a client with a resume token does."""

    def __init__(self, game: Game, number: int) -> None:
        self.game = game
        self.session = f"{game.tag}-{number}"
        self._chance = random.Random(f"{game.sim.seed}/{self.session}")
        self._machine: NodeMachine | None = None
        self._seen = 0.0
        self._seq = self._said = 0
        self._asked: messages.Act | None = None

    async def play(self) -> None:
        loop, machines = self.game.sim.loop, self.game.sim.machines
        while not self.game.over:
            await asyncio.sleep(self._chance.uniform(0.1, 0.7))
            if self._machine is None or loop.time() > self._seen + LOST_SECONDS:
                self._machine, self._seen = self._chance.choice(machines), loop.time()
            # The request waits while the process is stopped, and is lost when it dies.
            context = self._machine.process.context.copy()
            loop.call_soon(self._visit, self._machine, context=context)

    def _visit(self, machine: NodeMachine) -> None:
        """Do what a connection does when a message of this player arrives."""
        lobby, sessions = machine.lobby, machine.sessions
        room = lobby.rooms.get(self.game.id) if lobby is not None else None
        if room is None or sessions is None or room.writing:
            return
        self._seen = self.game.sim.loop.time()
        # As a request does that changes nothing, such as one for a snapshot.
        room._gate.when_committed(self, _nothing)
        try:
            session = self._enter(room, sessions)
            if not room.writing and not room.episode.ended:
                self._act(room, session)
        except ProtocolError as error:
            self.game.sim.trace("refused", machine.name, self.session, error)

    def _enter(self, room: Room, sessions: Sessions) -> Session:
        session = sessions.by_id.get(self.session)
        # A node may take over an episode that it has already. The player then comes back.
        if session is None or session.room not in (None, room):
            session = Session(self.session, name=self.session, kind="bot", role=Role.PLAYER)
            sessions.by_id[session.id] = session
        if session.room is not None:
            return session
        players = room.players_of(session.id)
        if not players:
            request = messages.Join(episode=room.code)
            room.enter(session, request, MAX_SPECTATORS)
        else:
            room.check_return(session.id)
            session.generation = room.episode.seat(players[0]).generation + 1
            room.readmit(session, players)
            room.connection_back(session, None)
        return session

    def _act(self, room: Room, session: Session) -> None:
        if self._chance.random() < 0.1:
            self._said += 1
            room.say(session, f"{self.session}/{self._said}")
        if session.player is None or not room.episode.running:
            return
        seat = room.episode.seat(session.player)
        asked, step = self._asked, room.episode.step
        # The same number again means the same action, unless it was rejected as outdated.
        if asked is None or seat.seq >= asked.seq or asked.basis != step:
            self._seq = max(self._seq, seat.seq) + 1
            actions = room.episode.state.actions(session.player)
            index = self._chance.randrange(len(actions)) if actions else None
            self._asked = messages.Act(seq=self._seq, action=index, basis=step)
        room.act(session, self._asked)


def _nothing() -> None:
    pass
