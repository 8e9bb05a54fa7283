"""Bare `websockets` server that speaks the protocol to load-test bots without simulating a world.

It measures the cost of the library alone. The server decodes the fields that it needs for an
answer, keeps an absolute schedule, and broadcasts messages of the size of deltas. It checks and
records nothing.
"""

from __future__ import annotations

import argparse
import asyncio
from bisect import bisect_left
from dataclasses import dataclass, field
from itertools import count
from typing import Any

import msgpack
from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from robotouille.protocol.codec import MSGPACK

BUCKETS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25, 1.0)
LATENESS = "robotouille_step_lateness_seconds"


@dataclass(eq=False)
class Room:
    """Room with two seats and a step schedule."""

    code: str
    clock: str
    period: float
    seats: list[ServerConnection | None] = field(default_factory=lambda: [None, None])
    watching: list[ServerConnection] = field(default_factory=list)
    taken: int = 0
    step: int = 0
    did: list[list[Any]] = field(default_factory=list)
    seq: list[int] = field(default_factory=list)

    @property
    def members(self) -> list[ServerConnection]:
        return [socket for socket in self.seats if socket is not None] + self.watching


class Bare:
    """Rooms of one process, with a histogram of step lateness."""

    def __init__(self) -> None:
        self.rooms: dict[str, Room] = {}
        self.counts = [0] * (len(BUCKETS) + 1)
        self._codes = count(1)
        self._loop = asyncio.get_running_loop()

    async def handle(self, socket: ServerConnection) -> None:
        place: tuple[Room, int] | None = None
        try:
            async for payload in socket:
                message = msgpack.unpackb(payload)
                kind = message["type"]
                if kind == "act" and place is not None:
                    self.act(*place, message)
                elif kind == "hello":
                    place = self.hello(socket, message.get("resume", ""))
                elif kind == "create":
                    self.create(socket, message)
                elif kind == "join":
                    place = self.join(socket, message)
        except ConnectionClosed:
            pass
        finally:
            if place is not None and place[1] >= 0 and place[0].seats[place[1]] is socket:
                place[0].seats[place[1]] = None

    def hello(self, socket: ServerConnection, resume: str) -> tuple[Room, int] | None:
        code, _, seat = resume.partition("/")
        room = self.rooms.get(code)
        send(socket, type="welcome", protocol=1, server="bare websockets", session="s",
             resume=resume or "none", resumed=room is not None)  # fmt: skip
        if room is None:
            return None
        room.seats[int(seat)] = socket
        self.welcome(socket, room, int(seat))
        return room, int(seat)

    def create(self, socket: ServerConnection, message: dict[str, Any]) -> None:
        code = f"room{next(self._codes)}"
        self.rooms[code] = Room(code, message["clock"], 1 / message["step_rate"])
        send(socket, type="created", episode=code, code=code)

    def join(self, socket: ServerConnection, message: dict[str, Any]) -> tuple[Room, int]:
        room = self.rooms[message["episode"]]
        if message["role"] == "spectator":
            room.watching.append(socket)
            self.welcome(socket, room, -1)
            return room, -1
        seat, room.taken = room.taken, room.taken + 1
        room.seats[seat] = socket
        self.welcome(socket, room, seat)
        if room.taken == 2:
            if room.clock == "realtime":
                due = self._loop.time() + room.period
                self._loop.call_at(due, self.on_time, room, due)
            for member in room.members:
                send(member, **roster(room))
        return room, seat

    def welcome(self, socket: ServerConnection, room: Room, seat: int) -> None:
        name = f"robot{seat + 1}" if seat >= 0 else None
        send(socket, type="joined", episode=room.code, code=room.code, role="player", seat=name,
             seq=0, step=room.step, resume=f"{room.code}/{seat}")  # fmt: skip
        send(socket, **{**roster(room), "type": "snapshot", "step": room.step})

    def act(self, room: Room, seat: int, message: dict[str, Any]) -> None:
        action = message["action"]
        if action is None:
            return
        room.did.append([seat, action["name"], *action["args"]])
        room.seq.append(message["seq"])
        if room.clock != "realtime":
            self.take_step(room)

    def on_time(self, room: Room, due: float) -> None:
        self.counts[bisect_left(BUCKETS, self._loop.time() - due)] += 1
        self.take_step(room)
        self._loop.call_at(due + room.period, self.on_time, room, due + room.period)

    def take_step(self, room: Room) -> None:
        room.step += 1
        delta = {"type": "delta", "step": room.step, "add": [17], "remove": [11]}
        if room.did:
            delta |= {"did": room.did, "seq": room.seq}
            room.did, room.seq = [], []
        broadcast(room.members, msgpack.packb(delta))

    def http(self, connection: ServerConnection, request: Request) -> Response | None:
        if request.path != "/metrics":
            return None
        below, lines = 0, []
        for limit, number in zip([*map(str, BUCKETS), "+Inf"], self.counts, strict=True):
            below += number
            lines.append(f'{LATENESS}_bucket{{le="{limit}"}} {below}')
        return connection.respond(200, "\n".join(lines) + "\n")


def roster(room: Room) -> dict[str, Any]:
    seats = [{"player": f"robot{i + 1}", "present": i < room.taken} for i in range(2)]
    phase = "running" if room.taken == 2 else "waiting"
    return {"type": "roster", "phase": phase, "turn": "robot1", "seats": seats}


def send(socket: ServerConnection, **message: Any) -> None:
    broadcast([socket], msgpack.packb(message))


async def main(port: int) -> None:
    bare = Bare()
    async with serve(
        bare.handle,
        "127.0.0.1",
        port,
        compression=None,
        subprotocols=[Subprotocol(MSGPACK.name)],
        process_request=bare.http,
        backlog=4096,
    ) as server:
        listening = next(iter(server.sockets)).getsockname()[1]
        print(f"bare websockets at ws://127.0.0.1:{listening}", flush=True)
        await asyncio.Event().wait()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, default=0)
    asyncio.run(main(parser.parse_args().port))
