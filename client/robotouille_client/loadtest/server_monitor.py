"""The server's process and its own metrics during a load test."""

from __future__ import annotations

import asyncio
import ipaddress
import re
import socket
import time
from dataclasses import dataclass, field
from http.client import HTTPException
from math import inf
from urllib.error import URLError
from urllib.request import urlopen

from robotouille.errors import MissingExtraError, RobotouilleError

LATENESS = "robotouille_step_lateness_seconds"
"""Histogram of the lateness of scheduled steps."""
DELTA_AGE = "robotouille_delta_age_seconds"
"""Histogram of the age of deltas when they are passed to the network."""
FETCH_SECONDS = 10.0


@dataclass(frozen=True, slots=True)
class ServerSample:
    """The server's use of the machine at a time, in monotonic seconds."""

    at: float
    cpu: float
    """Seconds of processor time so far, including child processes."""
    memory: int
    """Bytes of resident memory, including child processes."""
    busy: float
    """Seconds of processor time that all programs on the machine have used so far."""


class ServerProcess:
    """A local process and its children.

    Raises:
        RobotouilleError: The process does not exist.
    """

    def __init__(self, pid: int) -> None:
        try:
            import psutil
        except ImportError:
            raise MissingExtraError("Watching a process", "load") from None
        self._psutil = psutil
        self.pid = pid
        try:
            self._process = psutil.Process(pid)
            self._process.cpu_times()
        except psutil.Error as error:
            raise RobotouilleError(f"process {pid}: {_psutil_message(error)}") from None

    def sample(self) -> ServerSample | None:
        """Return the current usage, or None if the process has ended."""
        psutil = self._psutil
        cpu, memory = 0.0, 0
        try:
            family = [self._process, *self._process.children(recursive=True)]
        except psutil.Error:
            return None
        for process in family:
            try:
                with process.oneshot():
                    times = process.cpu_times()
                    cpu += times.user + times.system
                    memory += process.memory_info().rss
            except psutil.Error:
                continue
        all_times = psutil.cpu_times()
        idle = all_times.idle + getattr(all_times, "iowait", 0.0)
        return ServerSample(time.monotonic(), cpu, memory, sum(all_times) - idle)


def listener(port: int) -> int | None:
    """Return the process that listens on a local port, or None if it cannot be found."""
    try:
        import psutil
    except ImportError:
        return None
    try:
        connections = psutil.net_connections(kind="tcp")
    except psutil.Error:
        return None
    found = [
        c.pid
        for c in connections
        if c.status == "LISTEN" and c.laddr and c.laddr.port == port and c.pid
    ]
    return _eldest(found) if found else None


def _eldest(pids: list[int]) -> int:
    # Workers share the port of their supervisor, whose children are measured with it.
    import psutil

    for pid in sorted(pids):
        try:
            parents = {parent.pid for parent in psutil.Process(pid).parents()}
        except psutil.Error:
            continue
        shared = parents & set(pids)
        return min(shared) if shared else pid
    return pids[0]


def is_here(host: str) -> bool:
    """Return whether all addresses of a host are loopback addresses."""
    try:
        addresses = {info[4][0] for info in socket.getaddrinfo(host, None)}
    except OSError:
        return False
    return all(ipaddress.ip_address(str(a).partition("%")[0]).is_loopback for a in addresses)


@dataclass(frozen=True, slots=True)
class Buckets:
    """A Prometheus histogram: the number of observations up to each limit in seconds."""

    within: dict[float, float] = field(default_factory=dict)

    @property
    def count(self) -> float:
        return max(self.within.values(), default=0.0)

    def since(self, before: Buckets) -> Buckets:
        return Buckets({le: n - before.within.get(le, 0.0) for le, n in self.within.items()})

    def share_within(self, seconds: float) -> float | None:
        """Return the share of observations up to a bucket's limit, or None if it is unknown."""
        within = self.within.get(seconds)
        return within / self.count if within is not None and self.count else None

    def percentile(self, percent: float) -> float | None:
        """Return the seconds that `percent` do not exceed, interpolated, or None if unknown."""
        wanted = self.count * percent / 100
        low, before = 0.0, 0.0
        for limit, within in sorted(self.within.items()):
            if within >= wanted and within > before:
                if limit == inf:
                    return low
                return low + (limit - low) * (wanted - before) / (within - before)
            low, before = limit, within
        return None


@dataclass(frozen=True, slots=True)
class MetricsPage:
    """The server's metrics at a time. Counters that differ only in their labels are added."""

    values: dict[str, float] = field(default_factory=dict)
    histograms: dict[str, Buckets] = field(default_factory=dict)

    def since(self, before: MetricsPage) -> MetricsPage:
        """Return the increase since an earlier page."""
        values = {name: value - before.values.get(name, 0.0) for name, value in self.values.items()}
        histograms = {
            name: buckets.since(before.histograms.get(name, Buckets()))
            for name, buckets in self.histograms.items()
        }
        return MetricsPage(values, histograms)


MAX_PAGE_BYTES = 1_000_000
"""Largest page of metrics that is read. That of a busy server has 30 kB."""


async def fetch_page(url: str) -> MetricsPage | None:
    """Return the metrics at a URL, or None if they cannot be read."""
    try:
        return parse_page(await asyncio.to_thread(_read, url))
    except (URLError, OSError, ValueError, HTTPException):
        return None


def _read(url: str) -> str:
    if not url.startswith(("http://", "https://")):
        raise ValueError("only http and https URLs can be read")
    with urlopen(url, timeout=FETCH_SECONDS) as answer:  # noqa: S310
        content: bytes = answer.read(MAX_PAGE_BYTES + 1)
    if len(content) > MAX_PAGE_BYTES:
        raise ValueError("the page of metrics is too long")
    return content.decode(errors="replace")


def parse_page(text: str) -> MetricsPage:
    """Parse the part of the Prometheus exposition format that the server uses."""
    page = MetricsPage()
    for line in text.splitlines():
        match = re.fullmatch(r"(\w+)(?:\{(.*)\})? (\S+)(?: \d+)?", line)
        if match is None:
            continue
        name, labels, value = match[1], match[2] or "", float(match[3])
        limit = re.search(r'le="([^"]+)"', labels)
        if name.endswith("_bucket") and limit:
            within = page.histograms.setdefault(name.removesuffix("_bucket"), Buckets()).within
            le = float(limit[1])
            within[le] = within.get(le, 0.0) + value
        else:
            page.values[name] = page.values.get(name, 0.0) + value
    return page


def _psutil_message(error: Exception) -> str:
    return str(getattr(error, "msg", "") or error)
