"""Servers with several worker processes."""

from __future__ import annotations

import os
import random
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["COMMAND", "free_ports", "lasting_ports", "wait_for_ports", "workers"]


COMMAND = [sys.executable, "-m", "robotouille_server"]


def free_ports(count: int) -> int:
    """Return the first of `count` consecutive free ports."""
    while True:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            first = probe.getsockname()[1]
        try:
            for port in range(first, first + count):
                with socket.socket() as probe:
                    probe.bind(("127.0.0.1", port))
        except (OSError, OverflowError):
            continue
        return int(first)


def lasting_ports(count: int) -> int:
    """Return the first of `count` free ports outside the range of outgoing connections."""
    while True:
        first = random.SystemRandom().randrange(10_000, 32_768 - count)
        try:
            for port in range(first, first + count):
                with socket.socket() as probe:
                    probe.bind(("127.0.0.1", port))
        except OSError:
            continue
        return first


@contextmanager
def workers(folder: Path, count: int, *flags: str) -> Iterator[tuple[subprocess.Popen[str], int]]:
    port = free_ports(2 * count + 1)
    arguments = ["--port", str(port), "--workers", str(count), "--recordings", str(folder)]
    process = subprocess.Popen(
        [*COMMAND, *arguments, "--drain-seconds", "0", *flags],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "ROBOTOUILLE_COMPILE": "0"},
    )
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if "stop:" in line:
                break
        wait_for_ports(range(port, port + count + 1))
        yield process, port
    finally:
        if process.poll() is None:
            process.terminate()
        process.communicate(timeout=30)


def wait_for_ports(ports: range) -> None:
    for port in ports:
        for _ in range(600):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.05)
        else:
            raise AssertionError(f"no process listens on port {port}")
