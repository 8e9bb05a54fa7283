"""Bots that a player brings along to a kitchen on a server."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

COMMAND = (sys.executable, "-P", "-m", "robotouille_client.bots.cli")
PATIENCE = 2.0
"""Seconds that a process has to give its seat back."""


@dataclass(frozen=True, slots=True)
class CrewOptions:
    """Number of bots, and their kind: a planner's skill, or `random`."""

    count: int = 0
    partner: str = "partner"


class BotCrew:
    """Processes of `robotouille-bot`, which end with the player's visit.

    Args:
        url: Address of the server.
        token: Role token of the player, which the bots use, too.
    """

    def __init__(self, url: str, token: str | None, options: CrewOptions) -> None:
        self._url = url
        self._token = token
        self._options = options
        self._processes: list[subprocess.Popen[bytes]] = []
        self._leaving: list[subprocess.Popen[bytes]] = []

    def come(self, code: str) -> None:
        """Send bots to a kitchen. Those in the last one leave."""
        self.leave()
        partner = self._options.partner
        kind = ("random",) if partner == "random" else ("planner", "--skill", partner)
        for number in range(self._options.count):
            words = (*COMMAND, *kind, "--url", self._url, "--episode", code, "--seed", str(number))
            self._processes.append(self._start(words))

    def _start(self, words: tuple[str, ...]) -> subprocess.Popen[bytes]:
        # The token goes into the environment, because everybody on a machine can read arguments.
        token = {} if self._token is None else {"ROBOTOUILLE_TOKEN": self._token}
        return subprocess.Popen(  # noqa: S603
            words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, env={**os.environ, **token}
        )

    def news(self) -> Iterator[str]:
        """Yield a message for each bot that could not play, once."""
        for process in list(self._processes):
            if process.poll() not in (None, 0):
                self._processes.remove(process)
                yield "A bot could not join the game. The terminal shows why."

    def leave(self) -> None:
        """Ask the processes to end. The window goes on; `close` waits for them."""
        for process in self._processes:
            process.terminate()
        self._leaving += self._processes
        self._processes = []
        self._leaving = [process for process in self._leaving if process.poll() is None]

    def close(self) -> None:
        """End the processes, and wait for them."""
        self.leave()
        until = time.monotonic() + PATIENCE
        for process in self._leaving:
            try:
                process.wait(max(0.0, until - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._leaving = []


@contextlib.contextmanager
def bot_crew(url: str, token: str | None, options: CrewOptions) -> Iterator[BotCrew]:
    """Return a context with a crew, which leaves at its end."""
    crew = BotCrew(url, token, options)
    try:
        yield crew
    finally:
        crew.close()
