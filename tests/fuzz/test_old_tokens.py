"""Old tokens after decisions of the operator: random walks of an adversary that keeps every token
it ever received, with invariants that are checked after each step.
"""

from __future__ import annotations

import asyncio
import random
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed

from robotouille.protocol import messages
from robotouille_server import Server
from robotouille_server.auth.revocation import revoke
from robotouille_server.auth.roles import Role, same_episode
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.room import Room
from tests.support.handshakes import FORWARDED, hello, opened
from tests.support.servers import Raw, serving
from tests.support.thorough import FACTOR
from tests.support.virtual_time import run

NOW = 1_800_000_000.0
STEPS = 80
CAP = 1
KITCHEN = messages.Create(task="multi_agent/01_lettuce_burger", grace=86400.0)
HERE: dict[str, str] = {}
SEATS = ("robot1", "robot2", "robot9")


@dataclass
class Decisions:
    """Decisions of the operator so far, by episode where they concern one."""

    banned: dict[str, set[str]] = field(default_factory=dict)
    muted: dict[str, set[str]] = field(default_factory=dict)
    revoked: set[str] = field(default_factory=set)


class Walk:
    """Random walk of an adversary with many tokens and connections on a restarting server."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.random = random.Random(seed)
        self.folder = folder
        self.decisions = Decisions()
        self.rooms: list[str] = []
        self.role_tokens: list[str] = []
        self.resume_tokens: list[str] = []
        self.joined_once: dict[str, set[str]] = {}
        self.connections: list[Raw] = []
        self.strict = False
        self.ended: set[str] = set()
        self.done: list[str] = []
        self.server: Server
        self.stack: AsyncExitStack

    async def go(self) -> None:
        async with AsyncExitStack() as self.stack:
            await self.begin()
            for kind in Role:
                for subject in ("p-1", "p-2"):
                    for only in ("", self.rooms[0]):
                        self.mint(kind, subject, episode=only)
            for number in range(3):
                self.mint(Role.PLAYER, f"once-{number}", once=True)
            for _ in range(STEPS):
                act = self.random.choices(*zip(*ACTS, strict=True))[0]
                self.done.append(act.__name__)
                await act(self)
                await asyncio.sleep(1.5)  # The server notices a revoked token within this time.
                self.check()
            await self.stack.aclose()

    async def begin(self, seed: int = 1) -> None:
        options = {"require_token": self.strict, "max_spectators": CAP}
        whole = serving(self.folder, seed=seed, wall=lambda: NOW, **options)
        self.server = await self.stack.enter_async_context(whole)
        while len(self.rooms) < 2:
            self.rooms.append(self.server.lobby.create(KITCHEN, owner="").id)

    def mint(self, role: Role, subject: str, **limits: Any) -> None:
        token = self.server.tokens.mint_role(role, subject, seconds=1e7, **limits)
        self.role_tokens.append(token)

    def room(self) -> Room:
        return self.server.lobby.find(self.random.choice(self.rooms))

    def anyone(self) -> tuple[Room, Session] | None:
        pairs = [(room, who) for room in self.server.lobby.rooms.values() for who in room.members]
        return self.random.choice(pairs) if pairs else None

    # Actions of the adversary

    async def connect(self, **fields: Any) -> Raw:
        headers = self.random.choice((HERE, FORWARDED))
        connection = await self.stack.enter_async_context(opened(self.server, **headers))
        answer = await hello(connection, **fields)
        if answer["type"] == "welcome":
            self.resume_tokens.append(answer["resume"])
            self.connections.append(connection)
        return connection

    async def come(self) -> None:
        token = self.random.choice([None, *self.role_tokens])
        await self.connect(**({"token": token} if token else {}))
        await self.join()

    async def come_back(self) -> None:
        if self.resume_tokens:
            await self.connect(resume=self.random.choice(self.resume_tokens))

    async def join(self) -> None:
        role = self.random.choice(("player", "spectator"))
        await self.say(type="join", episode=self.random.choice(self.rooms), role=role)

    async def join_several(self) -> None:
        """Join several seats at once: free, taken, unknown or repeated ones."""
        seats = self.random.choice(("all", self.random.choices(SEATS, k=self.random.randint(1, 3))))
        await self.say(type="join", episode=self.random.choice(self.rooms), seats=seats)

    async def act(self) -> None:
        """Act and send a note for any seat."""
        seq, seat = self.random.randint(1, 50), self.random.choice(SEATS)
        await self.say(type="act", seq=seq, action=None, seat=seat)
        await self.say(type="note", topic="x", text="y", seat=seat)

    async def say(self, **message: Any) -> None:
        """Send a message on any connection and keep the tokens in its replies."""
        if not self.connections:
            return
        connection = self.random.choice(self.connections)
        with suppress(ConnectionClosed, TimeoutError):
            await connection.send(message)
            async with asyncio.timeout(0.2):
                while True:
                    answer = await connection.receive()
                    if answer["type"] in ("joined", "welcome"):
                        self.resume_tokens.append(answer["resume"])

    async def leave(self) -> None:
        await self.say(type="leave")

    async def talk(self) -> None:
        await self.say(type="say", text="x")

    async def open_one(self) -> None:
        before = set(self.server.lobby.rooms)
        scoped = {s.id for s in self.sessions() if s.limits.only_episode}
        hosts = {s.id for s in self.sessions() if s.role.includes(Role.HOST)}
        await self.say(type="create", task="synchronous/01")
        for name in set(self.server.lobby.rooms) - before:
            assert hosts - scoped, "an episode was opened without permission"
            self.server.lobby.find(name).abort("not needed")

    async def hang_up(self) -> None:
        if self.connections:
            connection = self.random.choice(self.connections)
            self.connections.remove(connection)
            await connection.socket.close()

    # Decisions of the operator

    async def kick(self) -> None:
        if found := self.anyone():
            room, who = found
            banned = self.decisions.banned.setdefault(room.id, set())
            banned |= {who.id, who.participant}
            room.kick(who, "rude")

    async def mute(self) -> None:
        if found := self.anyone():
            room, who = found
            self.decisions.muted.setdefault(room.id, set()).add(who.participant)
            room.mute(who)

    async def take_back(self) -> None:
        ids = [session.token_id for session in self.sessions() if session.token_id]
        if ids:
            token_id = self.random.choice(ids)
            self.decisions.revoked.add(token_id)
            path = self.server.settings.state_folder / "revoked.json"
            revoke(path, [token_id], NOW + 1e7, NOW)
            self.mint(self.random.choice(tuple(Role)), "p-3")

    async def restart(self) -> None:
        self.strict = self.random.random() < 0.5
        rooms = self.server.lobby.rooms.values()
        seated = {seat.session for room in rooms for seat in room.episode.seats.values()}
        # Sessions without a seat end with their process.
        self.ended |= self.server.sessions.by_id.keys() - seated
        await self.server.stop("restart", hand_over=True)
        self.connections.clear()
        await self.begin(seed=self.random.randrange(1, 10**6))

    # Invariants

    def sessions(self) -> list[Session]:
        return [s for s in self.server.sessions.by_id.values() if s.peer is not None]

    def check(self) -> None:
        for room in self.server.lobby.rooms.values():
            assert room.spectators <= CAP, self.done
            banned = self.decisions.banned.get(room.id, set())
            muted = self.decisions.muted.get(room.id, set())
            held = [player for who in room.members for player in who.players]
            taken = [seat.player for seat in room.episode.seats.values() if seat.taken]
            assert sorted(set(held)) == sorted(held), self.done
            assert room.episode.ended or set(held) <= set(taken), self.done
            for who in room.members:
                assert room.episode.ended or who.players == room.players_of(who.id), self.done
                assert banned.isdisjoint({who.id, who.participant}), self.done
                assert room.mutes(who) == (who.participant in muted), self.done
                only = who.limits.only_episode
                assert not only or same_episode(only, room.id), self.done
                if who.participant.startswith("once-"):
                    self.joined_once.setdefault(who.participant, set()).add(who.id)
        for who in self.sessions():
            assert who.id not in self.ended, self.done
            assert who.token_id not in self.decisions.revoked, self.done
            if who.token_id:
                continue
            assert not self.strict, self.done
            assert who.visitor is not None
            assert who.role is (Role.HOST if who.visitor.local else Role.PLAYER), self.done
        assert all(len(ids) == 1 for ids in self.joined_once.values()), self.done


ACTS = [
    (Walk.come, 8), (Walk.come_back, 10), (Walk.join, 6), (Walk.leave, 3), (Walk.talk, 2),
    (Walk.open_one, 2), (Walk.hang_up, 4), (Walk.kick, 2), (Walk.mute, 2), (Walk.take_back, 2),
    (Walk.restart, 2), (Walk.join_several, 6), (Walk.act, 4),
]  # fmt: skip


@pytest.mark.parametrize("seed", range(max(1, int(6 * FACTOR))))
def test_old_tokens_do_not_undo_decisions(tmp_path: Path, seed: int) -> None:
    run(Walk(seed, tmp_path / "r").go())
