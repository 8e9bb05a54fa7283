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

from robotouille.domain.rendering import NO_WORDS, Language
from robotouille.planning.policies.script import Did
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World
from robotouille_client.bots.kinds import BotKind
from robotouille_client.bots.partners import Decision

__all__ = ["PartnerProcess"]

COMMAND = (sys.executable, "-P", "-m", "robotouille_client.bots.partner_worker")
PLAIN = {"ROBOTOUILLE_COMPILE": "0"}
"""They plan in plain Python, unless the environment says otherwise: compiling takes half a minute,
and begins in the middle of a game, with the first plan in which the person has a part."""
CHUNK = 65536
LIVES = 2
"""Processes that are started for a game, one after the other."""

RESTARTED = "The bots' process ended: they think anew in another one"
GONE = "The bots' process ended again: they stand still, and the game goes on"


class PartnerProcess:
    """The bots of some players; their process lasts until `close`.

    Where it ends before, another one takes its place, once. Where that ends as well, the bots do
    nothing any more, and the game goes on without them.
    """

    def __init__(
        self,
        start: State,
        kind: BotKind,
        seed: int,
        players: Sequence[str],
        words: Language = NO_WORDS,
    ) -> None:
        self._world: World = start.world
        self._task = json.dumps(start.world.task.to_json())
        said_in = words.model_dump_json(exclude_unset=True)
        self._begin = kind.value, seed, list(players), said_in
        self._met: tuple[dict[str, str], str] | None = None
        self._asked: dict[str, tuple[Any, ...]] = {}
        self._replies: deque[Any] = deque()
        self._spoken: list[tuple[str, str]] = []
        self._news: list[str] = []
        self._closed = False
        self._lives = LIVES
        self._start()

    def _start(self) -> None:
        self._process = subprocess.Popen(  # noqa: S603
            COMMAND,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            env={**PLAIN, **os.environ},
        )
        self._reader = Thread(target=self._read, args=(self._process,), daemon=True)
        self._reader.start()
        self._send("begin", self._task, *self._begin)
        if self._met is not None:
            self._send("meet", *self._met)
        for question in self._asked.values():
            self._send(*question)

    def _start_anew(self) -> None:
        """The process has ended: another one begins with what is known and asked now."""
        self._end()
        self._lives -= 1
        if self._lives:
            self._news.append(RESTARTED)
            self._start()
        else:
            self._news.append(GONE)

    @property
    def pid(self) -> int:
        """That of the process in which they think."""
        return self._process.pid

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        self._met = dict(kinds), clock
        self._send("meet", *self._met)

    def observe(self, did: Did) -> None:
        moves = [(player, a.name, a.arguments, applied) for player, a, applied in did]
        self._send("observe", moves)

    def hear(self, player: str, text: str) -> None:
        self._send("hear", player, text)

    def ask(self, player: str, state: State) -> None:
        facts = state.facts.to_bytes((state.facts.bit_length() + 7) // 8, "big")
        self._asked[player] = "ask", player, facts, state.timer_rows(), state.timers.busy
        self._send(*self._asked[player])

    def answers(self) -> list[Decision]:
        ended = self._lives and not (self._reader.is_alive() or self._closed)
        found: list[Decision] = []
        while self._replies:
            what, player, told, *more = self._replies.popleft()
            if what == "say":
                self._spoken.append((player, told))
            elif self._asked.pop(player, None) is not None:
                action = None if told is None else self._action(*told)
                found.append(Decision(player, action, *more))
        if ended:
            self._start_anew()
        if not self._lives:
            found += [Decision(player, None) for player in self._asked]
            self._asked.clear()
        return found

    def news(self) -> list[str]:
        found, self._news = self._news, []
        return found

    def spoken(self) -> list[tuple[str, str]]:
        said, self._spoken = self._spoken, []
        return said

    def close(self) -> None:
        """End the process, whatever it thinks about."""
        if self._closed:
            return
        self._closed = True
        self._end()

    def _end(self) -> None:
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
        if self._lives and not self._closed:
            with contextlib.suppress(BrokenPipeError):
                self._input.write(msgpack.packb(request))

    def _read(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None  # noqa: S101
        unpacker = msgpack.Unpacker(use_list=False, max_buffer_size=0)
        with process.stdout as output:
            while data := os.read(output.fileno(), CHUNK):
                unpacker.feed(data)
                self._replies.extend(unpacker)
