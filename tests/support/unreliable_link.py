"""Network link to a namespace that delays, reorders and loses packets.

A thread carries packets between two TUN devices; one of them is in a network namespace. TCP runs in
the kernel, so its reaction to lost packets is real.
"""

from __future__ import annotations

import fcntl
import heapq
import math
import os
import random
import selectors
import shutil
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

__all__ = ["UnavailableError", "UnreliableLink", "unreliable_link"]

TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
HERE, THERE = "10.213.77.1", "10.213.77.2"
MTU = 1500


class UnavailableError(Exception):
    """This machine or user cannot create such a link."""


@dataclass(slots=True)
class UnreliableLink:
    """Unreliable link: `prefix` runs a command behind it, where it listens at `address`.

    Each packet takes `delay` seconds plus up to `jitter` seconds. `loss` is the share of lost
    packets. Each direction carries `rate` bytes a second. `carried` and `lost` count packets;
    `received` counts the bytes that came from behind the link.
    """

    prefix: tuple[str, ...]
    address: str
    delay: float
    jitter: float
    loss: float
    rate: float
    dice: random.Random
    carried: int = 0
    lost: int = 0
    received: int = 0
    _free: dict[int, float] = field(default_factory=dict)
    _late: list[tuple[float, int, int, bytes]] = field(default_factory=list)

    def carry(self, one: int, other: int, stop: threading.Event) -> None:
        """Carry packets both ways until `stop` is set."""
        with selectors.DefaultSelector() as ready:
            ready.register(one, selectors.EVENT_READ, other)
            ready.register(other, selectors.EVENT_READ, one)
            while not stop.is_set():
                wait = self._late[0][0] - time.monotonic() if self._late else 0.05
                for key, _ in ready.select(max(0.0, min(0.05, wait))):
                    packet = os.read(key.fd, MTU + 100)
                    self.received += len(packet) if key.fd == other else 0
                    self._take(packet, key.data)
                while self._late and self._late[0][0] <= time.monotonic():
                    _, _, device, packet = heapq.heappop(self._late)
                    os.write(device, packet)

    def _take(self, packet: bytes, device: int) -> None:
        if self.dice.random() < self.loss:
            self.lost += 1
            return
        self.carried += 1
        begun = max(time.monotonic(), self._free.get(device, 0.0))
        self._free[device] = begun + len(packet) / self.rate
        due = self._free[device] + self.delay + self.dice.random() * self.jitter
        heapq.heappush(self._late, (due, self.carried, device, packet))


@contextmanager
def unreliable_link(
    *,
    delay: float = 0.0,
    jitter: float = 0.0,
    loss: float = 0.0,
    rate: float = math.inf,
    seed: int = 0,
) -> Iterator[UnreliableLink]:
    """Create a link for the duration of the context.

    Raises:
        UnavailableError: Namespaces or TUN devices are missing or not permitted.
    """
    if shutil.which("ip") is None:
        raise UnavailableError("the program `ip` is missing")
    name = f"rough{os.getpid()}"
    inside = ("ip", "netns", "exec", name)
    _do("ip", "netns", "add", name)
    devices: list[int] = []
    stop = threading.Event()
    try:
        near, far = f"rn{os.getpid()}", f"rf{os.getpid()}"
        devices = [_tun(near), _tun(far)]
        _do("ip", "link", "set", far, "netns", name)
        _up(near, HERE, THERE)
        _up(far, THERE, HERE, inside)
        _do(*inside, "ip", "link", "set", "lo", "up")
        link = UnreliableLink(inside, THERE, delay, jitter, loss, rate, random.Random(seed))
        carrying = threading.Thread(target=link.carry, args=(*devices, stop), daemon=True)
        carrying.start()
        try:
            yield link
        finally:
            stop.set()
            carrying.join()
    finally:
        for device in devices:
            os.close(device)
        subprocess.run(("ip", "netns", "delete", name), check=False)


def _tun(name: str) -> int:
    try:
        device = os.open(Path("/dev/net/tun"), os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH14x", name.encode(), IFF_TUN | IFF_NO_PI))
    except OSError as error:
        raise UnavailableError(str(error)) from error
    return device


def _up(device: str, own: str, peer: str, inside: tuple[str, ...] = ()) -> None:
    _do(*inside, "ip", "address", "add", own, "peer", peer, "dev", device)
    _do(*inside, "ip", "link", "set", device, "up")


def _do(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise UnavailableError(f"{' '.join(command)}: {done.stderr.strip()}")
