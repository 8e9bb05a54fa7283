"""Bots that a player brings along to a kitchen on a server."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
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

    def come(self, code: str) -> None:
        """Send the bots to a kitchen, after they have left the last one."""
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

    def leave(self) -> None:
        """End the processes."""
        for process in self._processes:
            process.terminate()
        for process in self._processes:
            try:
                process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._processes.clear()


@contextlib.contextmanager
def bot_crew(url: str, token: str | None, options: CrewOptions) -> Iterator[BotCrew]:
    """Return a context with a crew, which leaves at its end."""
    crew = BotCrew(url, token, options)
    try:
        yield crew
    finally:
        crew.leave()
