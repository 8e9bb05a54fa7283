"""Bot partners that plan in a separate process (`partner_worker`).

A search in a thread would hold the interpreter's lock and delay frames.
"""

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

from robotouille.domain.rendering import NO_WORDS, Language
from robotouille.planning.bot_process import CHUNK, packed, state_row, unpacker
from robotouille.planning.policies.script import Did
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World
from robotouille_client.bots.kinds import BotKind
from robotouille_client.bots.partners import Decision

COMMAND = (sys.executable, "-P", "-m", "robotouille_client.bots.partner_worker")
PLAIN = {"ROBOTOUILLE_COMPILE": "0"}
"""Default environment: plan without compiled code. Compiling takes half a minute and would start
in the middle of a game, with the first plan that involves the person."""
LIVES = 2
"""Maximum number of processes per game, one after the other."""

RESTARTED = "The bots' process ended. The bots plan again in a new process."
GONE = "The bots' process ended again. The game continues without the bots."


class PartnerProcess:
    """Bots of some players in a process that runs until `close`.

    If the process dies, it is replaced once. If the replacement dies, too, the bots do nothing and
    the game continues without them.
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
        words_json = words.model_dump_json(exclude_unset=True)
        self._begin = kind.value, seed, list(players), words_json
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

    def _restart(self) -> None:
        """Replace a dead process. The new one gets all open questions."""
        self._end()
        self._lives -= 1
        if self._lives:
            self._news.append(RESTARTED)
            self._start()
        else:
            self._news.append(GONE)

    @property
    def pid(self) -> int:
        """Process id."""
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
        row = state_row(state.facts, state.timer_rows(), state.timers.busy)
        self._asked[player] = "ask", player, row
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
            self._restart()
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
        """End the process at once, even during a search."""
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
        # A process that has died is noticed by `answers`.
        if self._lives and not self._closed:
            with contextlib.suppress(BrokenPipeError):
                self._input.write(packed(*request))

    def _read(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None  # noqa: S101
        stream = unpacker()
        with process.stdout as output:
            while data := os.read(output.fileno(), CHUNK):
                stream.feed(data)
                self._replies.extend(stream)
