"""Several server processes on one port: starts them, and starts anew whichever dies.

Each worker listens on the shared port, among which the kernel spreads new connections, and on a
port of its own, to which clients are sent whose episode it has.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from types import FrameType

from robotouille.errors import RobotouilleError
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.runtime.workers import WorkerSlot

__all__ = ["supervise", "this_worker"]

COMMAND = (sys.executable, "-P", "-m", "robotouille_server")
"""A worker's; -P: no file of the current folder takes the place of a library."""
INDEX = "ROBOTOUILLE_WORKER_INDEX"
PARENT = "ROBOTOUILLE_WORKER_PARENT"
FIRST_PAUSE, LONGEST_PAUSE = 0.1, 5.0
LOOK_SECONDS = 0.05
HEALTHY_SECONDS = 10.0


def this_worker(settings: ServerSettings) -> WorkerSlot | None:
    """Which worker this process is; None if it is not one."""
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
    """Without its supervisor a worker would stay for ever."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, name="parent watch", daemon=True).start()


def supervise(settings: ServerSettings) -> int:
    """Run `settings.workers` workers until SIGINT or SIGTERM; the exit status."""
    if not hasattr(socket, "SO_REUSEPORT"):
        raise RobotouilleError("--workers: this system cannot share a port among processes")
    if settings.port == 0:
        raise RobotouilleError("--workers needs a fixed --port; the next ones are the workers' own")
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
                self._look_after(index)
            if self._hopeless():
                return 1
            time.sleep(LOOK_SECONDS)
        return self._wait()

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self._signals.append(number)

    def _look_after(self, index: int) -> None:
        process, now = self._processes[index], time.monotonic()
        if process is not None:
            if process.poll() is None:
                return
            lived = now - self._started[index]
            pause = FIRST_PAUSE if lived > HEALTHY_SECONDS else self._pauses[index]
            self._pauses[index] = min(LONGEST_PAUSE, pause * 2)
            self._next[index] = now + pause
            get_logger().error("worker died", worker=index, status=process.returncode)
            self._processes[index] = None
        elif now >= self._next[index] and not self._signals:
            environment = {**os.environ, INDEX: str(index), PARENT: str(os.getpid())}
            command = [*COMMAND, *sys.argv[1:]]
            self._processes[index] = subprocess.Popen(command, env=environment)  # noqa: S603
            self._started[index] = now

    def _hopeless(self) -> bool:
        """Whether no worker can be started, e.g. since the port is in use."""
        dead = all(process is None for process in self._processes)
        return dead and all(pause >= LONGEST_PAUSE for pause in self._pauses)

    def _wait(self) -> int:
        """Pass every signal on, until all workers have ended; their worst exit status."""
        workers = [process for process in self._processes if process is not None]
        sent = 0
        while living := [worker for worker in workers if worker.poll() is None]:
            for number in self._signals[sent:]:
                sent += 1
                for worker in living:
                    worker.send_signal(number)
            time.sleep(LOOK_SECONDS)
        return max((abs(worker.returncode) for worker in workers), default=0)
