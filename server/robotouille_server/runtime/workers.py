"""Worker processes that share a port, each with its own episodes.

The id and code of an episode show which worker has it, so every worker can redirect clients.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from types import FrameType

from robotouille.errors import RobotouilleError
from robotouille.protocol import messages
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.settings import ServerSettings


def is_id(name: str) -> bool:
    """Return whether a name has the form of an episode's id. Codes have another form."""
    return len(name) == 16 and all(digit in "0123456789abcdef" for digit in name)


CODE_LETTERS = "ABCDEFGHJKMNPQRSTUVWXYZ"
"""Letters that cannot be confused. Their number limits the number of workers."""


class ElsewhereError(Exception):
    """Another worker has the episode."""

    def __init__(self, episode: str, port: int, url: str) -> None:
        self.episode = episode
        self.port = port
        self.url = url
        super().__init__(f"{episode} is served on port {port}")

    def moved(self, ref: int | None) -> messages.Moved:
        return messages.Moved(ref=ref, episode=self.episode, port=self.port, url=self.url)


@dataclass(frozen=True, slots=True)
class WorkerSlot:
    """Position of a process among the workers.

    Attributes:
        index: The index of the worker.
        count: The number of workers.
        first_port: The own port of the first worker.
        url: A template for the address of a worker, with `{worker}`, or empty.
    """

    index: int = 0
    count: int = 1
    first_port: int = 0
    url: str = ""

    def mark_id(self, bits: int) -> str:
        """Return a 64-bit episode id whose first two digits are the worker's index."""
        name = f"{bits:016x}"
        return name if self.count == 1 else f"{self.index:02x}{name[2:]}"

    def mark_letter(self, letter: str) -> str:
        """Return the first letter of a code, which shows the worker."""
        return letter if self.count == 1 else CODE_LETTERS[self.index]

    def file_name(self, name: str) -> str:
        """Return the worker's own name for a file: `audit.log`, or `audit.0.log`."""
        stem, dot, suffix = name.rpartition(".")
        return name if self.count == 1 else f"{stem}.{self.index}{dot}{suffix}"

    def owns(self, episode: str) -> bool:
        """Return whether this worker continues the recording of an episode."""
        return self.count == 1 or self._of_id(episode) % self.count == self.index

    def check_here(self, name: str, code: str, code_length: int) -> None:
        """Raise ElsewhereError if an id or code belongs to another worker."""
        if self.count == 1:
            return
        if len(code) == code_length and code[0] in CODE_LETTERS:
            home = CODE_LETTERS.index(code[0]) % self.count
        elif is_id(name):
            home = self._of_id(name) % self.count
        else:
            return
        if home != self.index:
            raise ElsewhereError(name, *self._address(home))

    def addresses(self) -> list[messages.WorkerAddress]:
        """Return the addresses of all workers; empty if there is only one."""
        workers = range(self.count) if self.count > 1 else ()
        found = map(self._address, workers)
        return [messages.WorkerAddress(port=port, url=url) for port, url in found]

    def _address(self, worker: int) -> tuple[int, str]:
        return self.first_port + worker, self.url.replace("{worker}", str(worker))

    def _of_id(self, episode: str) -> int:
        try:
            return int(episode[:2], 16)
        except ValueError:
            return 0


COMMAND = (sys.executable, "-P", "-m", "robotouille_server")
"""Command of a worker. With -P, files in the current folder cannot replace libraries."""
INDEX = "ROBOTOUILLE_WORKER_INDEX"
PARENT = "ROBOTOUILLE_WORKER_PARENT"
FIRST_PAUSE, LONGEST_PAUSE = 0.1, 5.0
CHECK_SECONDS = 0.05
HEALTHY_SECONDS = 10.0


def this_worker(settings: ServerSettings) -> WorkerSlot | None:
    """Return the position of this process; None if it is not a worker."""
    index = os.environ.get(INDEX)
    if index is None or settings.workers == 1:
        return None
    _stop_with_parent(int(os.environ[PARENT]))
    return WorkerSlot(
        index=int(index),
        count=settings.workers,
        first_port=settings.port + 1,
        url=settings.worker_url,
    )


def _stop_with_parent(parent: int) -> None:
    """Stop when the supervisor dies; otherwise the worker would run forever."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os.kill(os.getpid(), signal.SIGTERM)

    # A thread, because the event loop does not run yet and a killed supervisor sends no signal.
    threading.Thread(target=watch, name="parent watch", daemon=True).start()


def supervise(settings: ServerSettings) -> int:
    """Run the workers until SIGINT or SIGTERM; return the exit status."""
    if not hasattr(socket, "SO_REUSEPORT"):
        raise RobotouilleError("--workers: this system cannot share a port between processes")
    if settings.port == 0:
        raise RobotouilleError(
            "--workers needs a fixed --port; the workers use the ports that follow it"
        )
    return _Supervisor(settings.workers).run()


class _Supervisor:
    def __init__(self, count: int) -> None:
        self._processes: list[subprocess.Popen[bytes] | None] = [None] * count
        self._started = [0.0] * count
        self._pauses = [FIRST_PAUSE] * count
        self._next = [0.0] * count
        self._signals: list[int] = []

    def run(self) -> int:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._stop)
        while not self._signals:
            for index in range(len(self._processes)):
                self._check(index)
            if self._hopeless():
                return 1
            time.sleep(CHECK_SECONDS)
        return self._wait()

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self._signals.append(number)

    def _check(self, index: int) -> None:
        process, now = self._processes[index], time.monotonic()
        if process is not None:
            if process.poll() is None:
                return
            lived = now - self._started[index]
            # A worker that dies right after its start, for example because its port is in use, must
            # not be started twenty times a second.
            pause = FIRST_PAUSE if lived > HEALTHY_SECONDS else self._pauses[index]
            self._pauses[index] = min(LONGEST_PAUSE, pause * 2)
            self._next[index] = now + pause
            get_logger().error("worker died", worker=index, status=process.returncode)
            self._processes[index] = None
        elif now >= self._next[index] and not self._signals:
            # In the environment, so that a worker gets the same command line as the supervisor.
            environment = {**os.environ, INDEX: str(index), PARENT: str(os.getpid())}
            command = [*COMMAND, *sys.argv[1:]]
            self._processes[index] = subprocess.Popen(command, env=environment)  # noqa: S603
            self._started[index] = now

    def _hopeless(self) -> bool:
        """Return whether no worker can be started, for example because the port is in use."""
        dead = all(process is None for process in self._processes)
        return dead and all(pause >= LONGEST_PAUSE for pause in self._pauses)

    def _wait(self) -> int:
        """Forward signals until all workers have ended; return their highest exit status."""
        workers = [process for process in self._processes if process is not None]
        sent = 0
        while living := [worker for worker in workers if worker.poll() is None]:
            for number in self._signals[sent:]:
                sent += 1
                for worker in living:
                    worker.send_signal(number)
            time.sleep(CHECK_SECONDS)
        return max((abs(worker.returncode) for worker in workers), default=0)
