"""Real NATS servers with JetStream on the loopback, and a link to them that tests can cut."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import signal
import socket
import struct
import subprocess
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Coroutine, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from tests.support.worker_processes import lasting_ports

__all__ = ["Link", "NatsCluster", "missing", "nats_cluster"]

PATIENCE = 60.0
"""Seconds until a cluster without a leader fails the test."""

RESETTING = (socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
"""Socket option with which closing a connection resets it."""

LINES = 40
"""Lines of each log that a failed test shows."""


def missing() -> str:
    """Return why NATS is unavailable, or an empty string."""
    if find_spec("nats") is None:
        return "nats-py is not installed"
    return "" if _program() else "nats-server is not installed"


def _program() -> str | None:
    name = "nats-server"
    return shutil.which(name) or shutil.which(name, path="/usr/sbin:/usr/local/sbin")


class _Ports(NamedTuple):
    client: int
    cluster: int
    monitor: int


class NatsCluster:
    """NATS servers that tests may kill, stop and start repeatedly.

    Servers have the names `nats0`, `nats1` and so on. They do not advertise each other to clients,
    so clients connect only to the addresses that they were given. `options` are lines for the
    configuration of every server, and `file_store` is the size of its JetStream on disk.
    """

    def __init__(self, folder: Path, servers: int, options: Sequence[str], file_store: str) -> None:
        self._folder = folder
        self._file_store = file_store
        # Outgoing connections must not take the port of a dead server, or connect to themselves.
        first = lasting_ports(3 * servers)
        self._ports = [_Ports(*range(at, at + 3)) for at in range(first, first + 3 * servers, 3)]
        self._processes: list[subprocess.Popen[bytes] | None] = [None] * servers
        self._stopped: set[int] = set()
        for i in range(servers):
            self._config(i).write_text("\n".join([*self._lines(i), *options]) + "\n")

    @property
    def urls(self) -> list[str]:
        """URLs of all servers."""
        return [self.url(i) for i in range(len(self._ports))]

    @property
    def pids(self) -> list[int]:
        """Process ids of the running servers."""
        return [each.pid for each in self._processes if each is not None]

    def url(self, i: int) -> str:
        """Return the URL of a server."""
        return f"nats://127.0.0.1:{self.port(i)}"

    def port(self, i: int) -> int:
        """Return the port for clients of a server."""
        return self._ports[i].client

    def index(self, name: str) -> int:
        """Return the index of the server with a name, such as the leader of a stream."""
        return int(name.removeprefix("nats"))

    def leader(self, stream: str) -> int:
        """Return the index of a stream's leader, or of the first server without a leader."""
        running = (i for i, each in enumerate(self._processes) if each and i not in self._stopped)
        for i in running:
            for account in self._ask(i, "jsz?streams=true").get("account_details", []):
                for detail in account.get("stream_detail", []):
                    leader = detail.get("cluster", {}).get("leader", "")
                    if detail["name"] == stream and leader:
                        return self.index(leader)
        return 0

    def start(self, i: int) -> None:
        """Start a server with the same ports and store. `wait` and `ready` wait for the cluster."""
        assert self._processes[i] is None, f"nats{i} already runs"
        with self._output(i).open("ab") as output:
            command = [str(_program()), "-c", str(self._config(i))]
            self._processes[i] = subprocess.Popen(command, stdout=output, stderr=output)

    def kill(self, i: int) -> None:
        """Kill a server with SIGKILL."""
        process, self._processes[i] = self._processes[i], None
        if process is not None:
            self._stopped.discard(i)
            process.kill()
            process.wait()

    def stop(self, i: int) -> None:
        """Stop a server with SIGSTOP: its connections stay open, but it does not answer."""
        process = self._running(i)
        process.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, process.pid, os.WSTOPPED)  # Its threads run a moment longer.
        self._stopped.add(i)

    def cont(self, i: int) -> None:
        """Let a stopped server continue."""
        self._running(i).send_signal(signal.SIGCONT)
        self._stopped.discard(i)

    def wait(self) -> None:
        """Wait until all running servers have the same meta leader, and are healthy."""
        until = time.monotonic() + PATIENCE
        while not self._agree():
            gone = [each.args for each in self._processes if each and each.poll() is not None]
            assert not gone and time.monotonic() < until, f"no meta leader\n{self.logs()}"
            time.sleep(0.02)

    async def ready(self) -> None:
        """Wait like `wait`, without blocking the event loop."""
        await asyncio.to_thread(self.wait)

    def logs(self) -> str:
        """Return the last lines of all logs."""
        files = [self._output(i) for i in range(len(self._ports))]
        tails = {each.name: each.read_text().splitlines() for each in files if each.exists()}
        return "\n".join(line for name, tail in tails.items() for line in [name, *tail[-LINES:]])

    def close(self) -> None:
        """Kill all servers, and print their logs, which pytest shows if the test failed."""
        for i in range(len(self._ports)):
            self.kill(i)
        print(self.logs())

    def _lines(self, i: int) -> Iterator[str]:
        own = self._ports[i]
        yield f"server_name: nats{i}"
        yield f"listen: 127.0.0.1:{own.client}"
        yield f"http: 127.0.0.1:{own.monitor}"
        yield f'jetstream {{store_dir: "{self._folder / f"nats{i}"}"'
        yield f"  max_memory_store: 64MB, max_file_store: {self._file_store}}}"
        if len(self._ports) > 1:
            routes = [f"nats://127.0.0.1:{each.cluster}" for each in self._ports if each != own]
            yield f"cluster {{name: tests, listen: 127.0.0.1:{own.cluster}, no_advertise: true"
            yield f"  routes: [{', '.join(routes)}]}}"

    def _config(self, i: int) -> Path:
        return self._folder / f"nats{i}.conf"

    def _output(self, i: int) -> Path:
        return self._folder / f"nats{i}.log"

    def _running(self, i: int) -> subprocess.Popen[bytes]:
        process = self._processes[i]
        assert process is not None, f"nats{i} does not run"
        return process

    def _agree(self) -> bool:
        running = [i for i, each in enumerate(self._processes) if each and i not in self._stopped]
        answers = [self._ask(i, "jsz") for i in running if self._ask(i, "healthz")]
        if len(answers) < len(running) or len(self._ports) == 1:
            return len(answers) == len(running)
        metas = [answer.get("meta_cluster", {}) for answer in answers]
        leaders = {meta.get("leader", "") for meta in metas}
        full = all(meta.get("cluster_size") == len(self._ports) for meta in metas)
        return full and len(leaders) == 1 and self._runs(leaders.pop(), running)

    def _runs(self, leader: str, running: Sequence[int]) -> bool:
        return bool(leader) and self.index(leader) in running

    def _ask(self, i: int, page: str) -> dict[str, Any]:
        address = f"http://127.0.0.1:{self._ports[i].monitor}/{page}"
        try:
            with urllib.request.urlopen(address, timeout=2) as answer:
                content: dict[str, Any] = json.load(answer)
                return content
        except urllib.error.HTTPError as error:
            error.close()
        except OSError:
            pass
        return {}


@contextmanager
def nats_cluster(
    folder: Path, servers: int = 3, options: Sequence[str] = (), file_store: str = "512MB"
) -> Iterator[NatsCluster]:
    """Run NATS servers with JetStream that have elected a meta leader."""
    folder.mkdir(parents=True, exist_ok=True)
    cluster = NatsCluster(folder, servers, options, file_store)
    try:
        for i in range(servers):
            cluster.start(i)
        cluster.wait()
        yield cluster
    finally:
        cluster.close()


class Link:
    """TCP proxy on a free port to a port of this machine, which runs in its own thread.

    Every method has taken effect when it returns.
    """

    def __init__(self, target: int) -> None:
        self._target = target
        self.port = lasting_ports(1)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._upward, self._downward = asyncio.Event(), asyncio.Event()
        self._server: asyncio.Server | None = None
        self._writers: set[asyncio.StreamWriter] = set()
        self._tasks: set[asyncio.Task[None]] = set()

    def __enter__(self) -> Link:
        self._thread.start()
        self.heal()
        return self

    def __exit__(self, *_: object) -> None:
        self._run(self._end())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    @property
    def url(self) -> str:
        """URL for clients of NATS."""
        return f"nats://127.0.0.1:{self.port}"

    def cut(self, *, up: bool = True, down: bool = True) -> None:
        """Carry nothing to the target (`up`) or from it (`down`), and keep all connections.

        As in a network whose packets are lost, programs notice nothing but silence. The bytes that
        they sent arrive after `heal`.
        """
        self._run(self._cut(up, down))

    def heal(self) -> None:
        """Carry everything again, and accept connections again after `close`."""
        self._run(self._heal())

    def close(self) -> None:
        """Reset all connections and refuse new ones."""
        self._run(self._close())

    def _run(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result()

    async def _cut(self, up: bool, down: bool) -> None:
        for way, chosen in ((self._upward, up), (self._downward, down)):
            if chosen:
                way.clear()

    async def _heal(self) -> None:
        self._upward.set()
        self._downward.set()
        if self._server is None:
            self._server = await asyncio.start_server(self._accept, "127.0.0.1", self.port)

    async def _close(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None
        for task in list(self._tasks):
            task.cancel()
        for writer in list(self._writers):
            with suppress(OSError):  # A connection that has just ended has no socket.
                writer.get_extra_info("socket").setsockopt(*RESETTING)
            writer.transport.abort()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _end(self) -> None:
        await self._close()
        await asyncio.sleep(0)  # Aborted transports close their sockets in the next iteration.

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        self._writers.add(writer)
        others: list[asyncio.StreamWriter] = []
        with suppress(OSError, asyncio.CancelledError):
            await self._upward.wait()
            far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._target)
            others.append(far_writer)
            self._writers.add(far_writer)
            async with asyncio.TaskGroup() as both:
                both.create_task(self._carry(reader, far_writer, self._upward))
                both.create_task(self._carry(far_reader, writer, self._downward))
        for each in (writer, *others):
            each.close()
            self._writers.discard(each)
        self._tasks.discard(task)

    async def _carry(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, way: asyncio.Event
    ) -> None:
        with suppress(OSError):
            while piece := await reader.read(1 << 16):
                await way.wait()
                writer.write(piece)
                await writer.drain()
            await way.wait()
            writer.close()
