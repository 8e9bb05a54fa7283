"""Who is connecting: the address, whether it is this machine, and whether it may come in.

All tables here are bounded, and time is an argument. An IPv6 address counts as its /64 network,
which is what one customer of a provider has.
"""

from __future__ import annotations

import ipaddress
import re
from collections import Counter, OrderedDict
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from urllib.parse import urlsplit

from websockets.datastructures import Headers

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille_server.runtime.token_bucket import TokenBucket

__all__ = [
    "AccessSettingError",
    "CodeGuessLimiter",
    "ConnectionLimiter",
    "CountedConnection",
    "TooManyConnectionsError",
    "Visitor",
    "comes_from",
    "counted_as",
    "origin_refusal",
    "parse_networks",
    "parse_origins",
    "visitor",
]

Address = ipaddress.IPv4Address | ipaddress.IPv6Address
Network = ipaddress.IPv4Network | ipaddress.IPv6Network

LOOPBACK: tuple[Network, ...] = (
    ipaddress.ip_network("127.0.0.0/8"),
    ipaddress.ip_network("::1/128"),
)
PRIVATE: tuple[Network, ...] = tuple(
    ipaddress.ip_network(text)
    for text in ("10.0.0.0/8", "172.16.0.0/12", "192.168.0.0/16", "fc00::/7", "fe80::/10")
)
PROXY_HEADERS = ("X-Forwarded-For", "Forwarded", "X-Real-IP", "X-Forwarded-Host", "Via")
"""Any of these says that the peer speaks for somebody else."""
MAX_HOPS = 32
WRONG_CODES_A_MINUTE = 20
UNKNOWN = "unknown"


class TooManyConnectionsError(ProtocolError):
    """`rate/connections`: somebody has as many connections as one may have."""


class AccessSettingError(RobotouilleError):
    """A value of `--origins`, `--trust-proxy` or `--metrics-from` that cannot be used."""


@dataclass(frozen=True, slots=True)
class Visitor:
    """Where a connection comes from.

    `address` is the client's as far as it can be trusted; `local` says that it is a program on
    this machine, not somebody behind a proxy on it; `group` is what limits count by.
    """

    address: str
    local: bool
    group: str


# Settings


def parse_networks(text: str, flag: str) -> tuple[Network, ...]:
    """What a setting lists: addresses, networks, `loopback` or `private` (both)."""
    networks: list[Network] = []
    for part in _parts(text):
        if part in ("loopback", "private"):
            networks += LOOPBACK if part == "loopback" else LOOPBACK + PRIVATE
            continue
        try:
            networks.append(ipaddress.ip_network(part))
        except ValueError as error:
            fault = f"{flag}: {error}; give addresses, networks, 'loopback' or 'private'"
            raise AccessSettingError(fault) from None
    return tuple(networks)


def parse_origins(text: str) -> frozenset[str]:
    """The web sites whose pages may connect: `https://kitchen.example.org,http://localhost:3000`."""
    return frozenset(_origin(part) for part in _parts(text))


def _origin(text: str) -> str:
    try:
        parts = urlsplit(text.rstrip("/"))
        whole = (
            parts.scheme and parts.hostname and not (parts.path or parts.query or parts.username)
        )
        _ = parts.port
    except ValueError:
        whole = ""
    if not whole:
        raise AccessSettingError(
            f"--origins: {text!r} is no origin; write it as https://HOST or https://HOST:PORT"
        )
    return text.rstrip("/").lower()


def _parts(text: str) -> Iterator[str]:
    return (part.strip() for part in text.split(",") if part.strip())


# Who it is


def visitor(peer: object, headers: Headers, proxies: Collection[Network] = ()) -> Visitor:
    """Who connects: `peer` is the socket's remote address, `headers` the request's.

    What a proxy of `proxies` says of where a request comes from is believed, hop by hop from the
    last; the first address that is none of theirs is the client's. X-Forwarded-For counts, and
    Forwarded where that is missing.
    """
    address = _address(peer[0]) if isinstance(peer, tuple) and peer else None
    if address is None:
        return Visitor(UNKNOWN, local=False, group=UNKNOWN)
    forwarded = any(name in headers for name in PROXY_HEADERS)
    local = address.is_loopback and not forwarded and _names_this_machine(headers)
    for hop in _hops(headers):
        if not any(address in network for network in proxies):
            break
        claimed = _address(hop)
        if claimed is None:
            break
        address = claimed
    return Visitor(str(address), local, _group(address))


def comes_from(peer: object, headers: Headers, networks: Collection[Network]) -> bool:
    """Whether a request comes from one of these networks, and from nobody behind a proxy there."""
    address = _address(peer[0]) if isinstance(peer, tuple) and peer else None
    if address is None or any(name in headers for name in PROXY_HEADERS):
        return False
    return any(address in network for network in networks)


def _address(text: object) -> Address | None:
    """An address with or without port or brackets; IPv4 in IPv6's clothes is IPv4."""
    host = str(text).strip().strip('"')
    if match := re.fullmatch(r"\[([^\]]*)\](?::\d+)?|([0-9.]+):\d+", host):
        host = match[1] if match[1] is not None else match[2]
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return None
    mapped = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
    return mapped or address


def _group(address: Address) -> str:
    if isinstance(address, ipaddress.IPv4Address):
        return str(address)
    return str(ipaddress.ip_network((address, 64), strict=False))


def _names_this_machine(headers: Headers) -> bool:
    """Whether Host is a name of loopback: a proxy, or a page whose name has been bound to
    127.0.0.1, sends the public name."""
    host = ",".join(headers.get_all("Host")).lower()
    address = _address(host)
    if address is not None:
        return address.is_loopback
    return host.partition(":")[0] in ("", "localhost")


def _hops(headers: Headers) -> list[str]:
    """Where the request has been according to proxies, the last first."""
    if "X-Forwarded-For" in headers:
        hops = ",".join(headers.get_all("X-Forwarded-For")).split(",")
    else:
        hops = [
            match[1] if (match := re.search(r"(?:^|;)\s*for=([^;]*)", element, re.I)) else ""
            for element in ",".join(headers.get_all("Forwarded")).split(",")
        ]
    return hops[: -MAX_HOPS - 1 : -1]


def origin_refusal(headers: Headers, allowed: Collection[str]) -> str | None:
    """Why a page of this origin may not connect; None if it may, or if it is no page at all.

    Browsers always send Origin and other programs do not: so a page somewhere on the web cannot
    use the server of whoever looks at it.
    """
    origins = headers.get_all("Origin")
    if not origins or (len(origins) == 1 and origins[0].rstrip("/").lower() in allowed):
        return None
    shown = ", ".join(origins)[:200]
    return (
        f"Pages of {shown} may not connect to this server. "
        f"Its operator can allow them with the setting --origins (ROBOTOUILLE_ORIGINS).\n"
    )


# How often


def counted_as(who: Visitor, subject: str) -> Visitor:
    """As whom limits count somebody: whoever brings a token by its subject, from everywhere, so
    that strangers behind the same address take nothing from them."""
    return replace(who, group=f"subject {subject}") if subject else who


@dataclass(eq=False, slots=True)
class CountedConnection:
    """A connection as limits count it. `close` ends it; `slot` is the group of which it has
    taken a slot, None while it is on probation."""

    who: Visitor
    close: Callable[[], None]
    slot: str | None = None


class ConnectionLimiter:
    """Counts connections; programs on this machine are not limited.

    A connection is on probation until it has said who it is: `limit` of each address are, and one
    more takes the place of that which has been silent the longest. Then it needs one of the
    `limit` slots of its address or, with a token, of its subject.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._waiting: dict[str, dict[CountedConnection, None]] = {}
        self._slots: Counter[str] = Counter()

    def arrive(self, connection: CountedConnection) -> None:
        """One more connection, on probation; the oldest of the address may have to go for it."""
        if connection.who.local:
            return
        waiting = self._waiting.setdefault(connection.who.group, {})
        waiting[connection] = None
        if len(waiting) > self._limit:
            oldest = next(iter(waiting))
            del waiting[oldest]
            oldest.close()

    def admit(
        self,
        connection: CountedConnection,
        who: Visitor,
        instead_of: CountedConnection | None = None,
    ) -> None:
        """Give a connection one of the slots of `who`, or that of the connection which it
        replaces; TooManyConnectionsError if all are taken."""
        if who.local:
            return
        if instead_of is not None and instead_of.slot == who.group:
            self.release(instead_of)
        if self._slots[who.group] >= self._limit:
            text = f"you have {self._limit} connections already; close some of them first"
            raise TooManyConnectionsError("rate/connections", text)
        self._leave_probation(connection)
        self._slots[who.group] += 1
        connection.slot = who.group

    def release(self, connection: CountedConnection) -> None:
        """A connection is over, or has been replaced."""
        self._leave_probation(connection)
        group, connection.slot = connection.slot, None
        if group is not None:
            self._slots[group] -= 1
            if self._slots[group] <= 0:
                del self._slots[group]

    def _leave_probation(self, connection: CountedConnection) -> None:
        waiting = self._waiting.get(connection.who.group)
        if waiting is not None:
            waiting.pop(connection, None)
            if not waiting:
                del self._waiting[connection.who.group]

    @property
    def groups(self) -> int:
        """How many groups are remembered: never more than there are connections."""
        return len(self._waiting) + len(self._slots)


class CodeGuessLimiter:
    """Join codes cannot be guessed by trying: each group (of addresses, or the bearers of a
    subject's tokens) has `burst` wrong ones, and gets one back every `60 / burst` seconds.

    At most `capacity` groups are remembered; those whose budget is whole again are forgotten
    first, then those whose last wrong code is longest ago.
    """

    def __init__(self, burst: int = WRONG_CODES_A_MINUTE, capacity: int = 10_000) -> None:
        self._burst = burst
        self._capacity = capacity
        self._budgets: OrderedDict[str, TokenBucket] = OrderedDict()

    def check(self, who: Visitor, now: float) -> None:
        """Before a code is looked up: ProtocolError `rate/codes` if too many were wrong."""
        budget = self._budgets.get(who.group)
        if budget is not None and not who.local and budget.left(now) < 1:
            text = "too many wrong codes; try again in a minute"
            raise ProtocolError("rate/codes", text, "episode")

    def wrong(self, who: Visitor, now: float) -> None:
        """A code was wrong."""
        if who.local:
            return
        budget = self._budgets.pop(who.group, None)
        if budget is None:
            budget = TokenBucket(self._burst / 60, now, self._burst)
        budget.take(now)
        self._budgets[who.group] = budget
        self._forget(now)

    def __len__(self) -> int:
        return len(self._budgets)

    def _forget(self, now: float) -> None:
        while self._budgets:
            oldest = next(iter(self._budgets.values()))
            if len(self._budgets) <= self._capacity and oldest.left(now) < self._burst:
                break
            self._budgets.popitem(last=False)
