"""Episodes of a simulated cluster, and players who look for them on one node after another."""

from __future__ import annotations

import asyncio
import random
from typing import TYPE_CHECKING, Any

from robotouille.episode import Phase
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
FLOODED = 2
"""The games of every second seed have a player who floods."""
FLOOD_SECONDS = 0.02
"""Longest time between two bursts of a flood."""


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
        if sim.seed % FLOODED == 0:
            self.players[-1] = Flooder(self, seats - 1)

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
            await asyncio.sleep(self._pause())
            lost = loop.time() > self._seen + LOST_SECONDS
            if self._machine is None or lost or self._impatient:
                self._machine, self._seen = self._chance.choice(machines), loop.time()
            # The request waits while the process is stopped, and is lost when it dies.
            context = self._machine.process.context.copy()
            loop.call_soon(self._visit, self._machine, context=context)

    @property
    def _impatient(self) -> bool:
        """True if messages arrive at all nodes, also while the recording is being written."""
        return False

    def _pause(self) -> float:
        """Return the seconds until the next message."""
        return self._chance.uniform(0.1, 0.7)

    def _visit(self, machine: NodeMachine) -> None:
        """Do what a connection does when a message of this player arrives."""
        lobby, sessions = machine.lobby, machine.sessions
        room = lobby.rooms.get(self.game.id) if lobby is not None else None
        if room is None or sessions is None or (room.writing and not self._impatient):
            return
        self._seen = self.game.sim.loop.time()
        # As a request does that changes nothing, such as one for a snapshot.
        room._gate.when_committed(self, _nothing)
        try:
            session = self._enter(room, sessions)
            if (not room.writing or self._impatient) and not room.episode.ended:
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


class Flooder(Player):
    """Player who sends everything that a client may send, in bursts, while there are faults.

    It then plays on, so that the episode ends.
    """

    @property
    def _impatient(self) -> bool:
        # Each burst is from another connection, so the server reads its first message.
        return self.game.sim.troubled

    def _pause(self) -> float:
        return self._chance.uniform(0.0, FLOOD_SECONDS) if self._impatient else super()._pause()

    def _enter(self, room: Room, sessions: Sessions) -> Session:
        session = super()._enter(room, sessions)
        if not self._impatient and session.player is None:
            room.leave(session)
            return super()._enter(room, sessions)
        return session

    def _act(self, room: Room, session: Session) -> None:
        if not self._impatient:
            if session.player is not None and room.episode.phase is Phase.WAITING:
                room.set_ready(session, True)
            super()._act(room, session)
            return
        requests = (
            self._act_anyhow,
            self._act_anyhow,
            self._act_anyhow,
            self._talk,
            self._write_note,
            self._change_ready,
            self._come_back,
            self._watch,
            self._leave_and_join,
        )
        for _ in range(self._chance.choice((1, 5, 50))):
            self.game.sim.oracle.counts["flooding requests"] += 1
            try:
                self._chance.choice(requests)(room, session)
            except ProtocolError as error:
                self.game.sim.trace("flood refused", self.session, error.code)
            # The server reads nothing more from this connection until the recording is written.
            if room.writing or room.episode.ended or session.room is not room:
                return

    def _act_anyhow(self, room: Room, session: Session) -> None:
        seq = room.episode.seat(session.player).seq if session.player is not None else 0
        action = self._chance.choice((None, 0, 1, 7, 10_000, "fly", "x" * 2000))
        basis = room.episode.step + self._chance.choice((-1, 0, 0, 1))
        number = max(1, seq + self._chance.choice((-1, 0, 1, 2)))
        room.act(session, messages.Act(seq=number, action=action, basis=max(0, basis)))

    def _talk(self, room: Room, session: Session) -> None:
        self._said += 1
        room.say(session, f"{self.session}/{self._said}")

    def _write_note(self, room: Room, session: Session) -> None:
        room.note(session, messages.Note(topic="flood", text="x" * self._chance.choice((1, 8000))))

    def _change_ready(self, room: Room, session: Session) -> None:
        room.set_ready(session, self._chance.random() < 0.7)

    def _come_back(self, room: Room, session: Session) -> None:
        """Lose the connection and come back."""
        room.check_return(session.id)
        room.connection_lost(session)
        session.generation += 1
        room.connection_back(session, None)

    def _watch(self, room: Room, session: Session) -> None:
        room.leave(session)
        room.enter(session, messages.Join(episode=room.code, role="spectator"), MAX_SPECTATORS)

    def _leave_and_join(self, room: Room, session: Session) -> None:
        room.leave(session)
        room.enter(session, messages.Join(episode=room.code), MAX_SPECTATORS)


def _nothing() -> None:
    pass
