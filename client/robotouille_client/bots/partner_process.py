"""Bots that think in a process of their own (`partner_worker`), so that no frame waits for them: a
search in a thread would hold the interpreter's lock."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections import deque
from collections.abc import Mapping, Sequence
from threading import Thread
from typing import Any

import msgpack

from robotouille.errors import RobotouilleError
from robotouille.planning.policies.script import Did
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World
from robotouille_client.bots.kinds import BotKind

__all__ = ["PartnerProcess"]

COMMAND = (sys.executable, "-P", "-m", "robotouille_client.bots.partner_worker")
CHUNK = 65536


class PartnerProcess:
    """The bots of some players; their process lasts until `close`."""

    def __init__(self, start: State, kind: BotKind, seed: int, players: Sequence[str]) -> None:
        self._world: World = start.world
        self._replies: deque[Any] = deque()
        self._spoken: list[tuple[str, str]] = []
        self._closed = False
        self._process = subprocess.Popen(  # noqa: S603
            COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
        )
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()
        task = json.dumps(start.world.task.to_json())
        self._send("begin", task, kind.value, seed, list(players))

    @property
    def pid(self) -> int:
        """That of the process in which they think."""
        return self._process.pid

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        self._send("meet", dict(kinds), clock)

    def observe(self, did: Did) -> None:
        moves = [(player, a.name, a.arguments, applied) for player, a, applied in did]
        self._send("observe", moves)

    def hear(self, player: str, text: str) -> None:
        self._send("hear", player, text)

    def ask(self, player: str, state: State) -> None:
        facts = state.facts.to_bytes((state.facts.bit_length() + 7) // 8, "big")
        self._send("ask", player, facts, state.timer_rows(), state.timers.busy)

    def answers(self) -> list[tuple[str, GroundAction | None]]:
        ended = not (self._reader.is_alive() or self._closed)
        found: list[tuple[str, GroundAction | None]] = []
        while self._replies:
            what, player, said = self._replies.popleft()
            if what == "say":
                self._spoken.append((player, said))
            else:
                found.append((player, None if said is None else self._action(*said)))
        if ended and not found:
            status = self._process.wait()
            raise RobotouilleError(f"the bots' process has ended (exit status {status})")
        return found

    def spoken(self) -> list[tuple[str, str]]:
        said, self._spoken = self._spoken, []
        return said

    def close(self) -> None:
        """End the process, whatever it thinks about."""
        if self._closed:
            return
        self._closed = True
        self._process.kill()
        self._process.wait()
        self._reader.join()
        with contextlib.suppress(OSError):
            self._input.close()

    def _action(self, name: str, *arguments: str) -> GroundAction:
        self._world.admit(arguments)
        return self._world.action(name, *arguments)

    @property
    def _input(self) -> Any:
        return self._process.stdin

    def _send(self, *request: Any) -> None:
        """Write a request; `answers` tells of a process that has ended."""
        if not self._closed:
            with contextlib.suppress(BrokenPipeError):
                self._input.write(msgpack.packb(request))

    def _read(self) -> None:
        assert self._process.stdout is not None  # noqa: S101
        unpacker = msgpack.Unpacker(use_list=False, max_buffer_size=0)
        with self._process.stdout as output:
            while data := os.read(output.fileno(), CHUNK):
                unpacker.feed(data)
                self._replies.extend(unpacker)
