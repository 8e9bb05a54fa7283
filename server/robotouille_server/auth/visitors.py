"""Visitors: addresses of clients, allowed origins, and limits per address.

All tables are bounded, and time is an argument. Limits count an IPv6 address as its /64 network,
because one customer of a provider usually has that many addresses. Many customers have a whole /56
or /48, so connections have a second, larger limit per /48.
"""

from __future__ import annotations

import ipaddress
import re
from collections import Counter, OrderedDict
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace

from websockets.datastructures import Headers

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille_server.runtime.budgets import TokenBucket

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
"""Headers of proxies, which forward the requests of others."""
MAX_HOPS = 32
WRONG_CODES_A_MINUTE = 20
UNKNOWN = "unknown"
# Origins become part of the page's content security policy, so a host must not contain `;`, spaces
# or wildcards. Browsers write other letters as `xn--…`.
_ORIGIN = re.compile(
    r"[a-z][a-z0-9+.-]*://(?:[a-z0-9._-]+|\[[0-9a-f:.]+\])(?::(?P<port>[0-9]{1,5}))?"
)
SITE_FACTOR = 16
"""Limit of connections per IPv6 /48 network, as a multiple of that per address."""
PROBATION_FACTOR = 8
"""Limit of connections of an address before `hello`, as a multiple of that after it. An address may
be shared by strangers, who must not displace a client before its `hello` can arrive."""


class TooManyConnectionsError(ProtocolError):
    """A client has reached the maximum number of connections (`rate/connections`)."""


class AccessSettingError(RobotouilleError):
    """The value of `--origins`, `--trust-proxy` or `--metrics-from` is invalid."""


@dataclass(frozen=True, slots=True)
class Visitor:
    """Origin of a connection.

    Attributes:
        address: The trusted address of the client.
        local: True if the client is a program on this machine, and not behind a proxy on it.
        group: The name under which limits count the client.
        site: The /48 network of an IPv6 address, or empty.
    """

    address: str
    local: bool
    group: str
    site: str = ""

    @property
    def turn_group(self) -> str | None:
        """The clients with which the visitor shares turns; None for a program on this machine.

        An IPv6 /48 network is one group. Otherwise, its owner could have 65,536 turns.
        """
        return None if self.local else self.site or self.group


# Settings


def parse_networks(text: str, flag: str) -> tuple[Network, ...]:
    """Parse a list of addresses and networks.

    `loopback` means this machine; `private` means all private networks and this machine.
    """
    networks: list[Network] = []
    for part in _parts(text):
        if part in ("loopback", "private"):
            networks += LOOPBACK if part == "loopback" else LOOPBACK + PRIVATE
            continue
        try:
            networks.append(ipaddress.ip_network(part))
        except ValueError as error:
            fault = f"{flag}: {error}; expected addresses, networks, 'loopback' or 'private'"
            raise AccessSettingError(fault) from None
    return tuple(networks)


def parse_origins(text: str, flag: str = "--origins") -> frozenset[str]:
    """Parse a list of web origins, such as `https://example.org,http://localhost:3000`."""
    return frozenset(_origin(part, flag) for part in _parts(text))


def _origin(text: str, flag: str) -> str:
    origin = text.rstrip("/").lower()
    if not _is_origin(origin):
        expected = _in_ascii(origin) or "https://HOST or https://HOST:PORT"
        raise AccessSettingError(f"{flag}: {text!r} is not an origin; expected {expected}")
    return origin


def _is_origin(text: str) -> bool:
    found = _ORIGIN.fullmatch(text)
    return found is not None and int(found["port"] or 0) <= 65_535


def _in_ascii(origin: str) -> str:
    """Return an origin with other letters than ASCII as browsers write it, or an empty text."""
    scheme, _, host = origin.partition("://")
    try:
        encoded = host.encode("idna")
        # Python still replaces some letters, such as `ß`, which browsers keep.
        unchanged = encoded.decode("idna") == host
    except UnicodeError:
        return ""
    found = f"{scheme}://{encoded.decode()}"
    return found if unchanged and _is_origin(found) else ""


def _parts(text: str) -> Iterator[str]:
    return (part.strip() for part in text.split(",") if part.strip())


# Addresses


def visitor(peer: object, headers: Headers, proxies: Collection[Network] = ()) -> Visitor:
    """Return where a connection comes from.

    The forwarding headers of trusted proxies are followed hop by hop, from the last one. The first
    address that is not a trusted proxy is the client. `Forwarded` is used if `X-Forwarded-For` is
    missing.

    Args:
        peer: The remote address of the socket.
        headers: The headers of the request.
        proxies: The trusted proxies.
    """
    address = _peer_address(peer)
    if address is None:
        return Visitor(UNKNOWN, local=False, group=UNKNOWN)
    forwarded = any(name in headers for name in PROXY_HEADERS)
    # A proxy on this machine also connects from a loopback address, but its headers or the public
    # name in `Host` show that it forwards another client (docs/security.md, "Posing as a local
    # program").
    # A web page is not a program of this machine's users, even if it is on this server.
    page = "Origin" in headers
    local = address.is_loopback and not (forwarded or page) and _names_this_machine(headers)
    for hop in _hops(headers):
        # Any client can send `X-Forwarded-For`. Only a hop that a trusted proxy has added counts.
        if not any(address in network for network in proxies):
            break
        claimed = _address(hop)
        if claimed is None:
            break
        address = claimed
    return Visitor(str(address), local, _group(address), _site(address))


def newcomer_group(peer: object, proxies: Collection[Network]) -> str:
    """Return the name under which a connection without a request counts; empty for no limit.

    Programs on this machine and trusted proxies are not limited.
    """
    who = _newcomer(peer, proxies)
    return "" if who is None else who.group


def newcomer_turn_group(peer: object, proxies: Collection[Network]) -> str | None:
    """Return the group with which a connection without a request shares turns.

    Programs on this machine and connections of trusted proxies have turns of their own: None.
    """
    who = _newcomer(peer, proxies)
    return None if who is None else who.turn_group


def _newcomer(peer: object, proxies: Collection[Network]) -> Visitor | None:
    address = _peer_address(peer)
    if address is None:
        return Visitor(UNKNOWN, local=False, group=UNKNOWN)
    if address.is_loopback or any(address in network for network in proxies):
        return None
    return Visitor(str(address), local=False, group=_group(address), site=_site(address))


def comes_from(peer: object, headers: Headers, networks: Collection[Network]) -> bool:
    """Return whether a request comes directly, without a proxy, from one of these networks."""
    address = _peer_address(peer)
    # The metrics may not be read through a proxy, whose address could be in the allowed network.
    if address is None or any(name in headers for name in PROXY_HEADERS):
        return False
    return any(address in network for network in networks)


def _peer_address(peer: object) -> Address | None:
    return _address(peer[0]) if isinstance(peer, tuple) and peer else None


def _address(text: object) -> Address | None:
    """Parse an address, with or without port and brackets. IPv4-mapped IPv6 becomes IPv4."""
    host = str(text).strip().strip('"')
    if match := re.fullmatch(r"\[([^\]]*)\](?::\d+)?|([0-9.]+):\d+", host):
        host = match[1] if match[1] is not None else match[2]
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return None
    mapped = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
    return mapped or address


def is_address(text: str) -> bool:
    """Return whether a host is an IP address, without a port."""
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return True


def _group(address: Address) -> str:
    if isinstance(address, ipaddress.IPv4Address):
        return str(address)
    # Limiting single IPv6 addresses would limit nobody: a customer can use 2 ** 64 of them.
    return str(ipaddress.ip_network((address, 64), strict=False))


def _site(address: Address) -> str:
    if isinstance(address, ipaddress.IPv4Address) or address.is_loopback:
        return ""
    return str(ipaddress.ip_network((address, 48), strict=False))


def _names_this_machine(headers: Headers) -> bool:
    """Return whether the Host header names this machine.

    A request through a proxy has the public name. So has a request from a web page whose domain
    was rebound to 127.0.0.1, which must not count as local.
    """
    host = ",".join(headers.get_all("Host")).lower()
    address = _address(host)
    if address is not None:
        return address.is_loopback
    return host.partition(":")[0] in ("", "localhost")


def _hops(headers: Headers) -> list[str]:
    """Return the hops of a request according to its proxies, last first."""
    if "X-Forwarded-For" in headers:
        hops = ",".join(headers.get_all("X-Forwarded-For")).split(",")
    else:
        hops = [
            match[1] if (match := re.search(r"(?:^|;)\s*for=([^;]*)", element, re.I)) else ""
            for element in ",".join(headers.get_all("Forwarded")).split(",")
        ]
    # The last hops were added by the nearest proxies; a client can only forge the first ones.
    return hops[: -MAX_HOPS - 1 : -1]


def origin_refusal(headers: Headers, allowed: Collection[str]) -> str | None:
    """Return why a web page may not connect; None for allowed pages and other programs.

    Browsers always send `Origin`; other programs do not. Without this check, any web page could
    use a server on the machine of the person who visits it.
    """
    origins = headers.get_all("Origin")
    if not origins or (len(origins) == 1 and origins[0].rstrip("/").lower() in allowed):
        return None
    shown = ", ".join(origins)[:200]
    return (
        f"Pages of {shown} may not connect to this server. "
        f"Its operator can allow them with the setting --origins (ROBOTOUILLE_ORIGINS).\n"
    )


# Limits


def counted_as(who: Visitor, subject: str) -> Visitor:
    """Return the visitor to count: a token's bearer counts by subject, from every address.

    Otherwise, strangers behind the same address could use up the bearer's limits.
    """
    return replace(who, group=f"subject {subject}", site="") if subject else who


@dataclass(eq=False, slots=True)
class CountedConnection:
    """Connection as limits count it.

    Attributes:
        who: Where the connection comes from.
        close: Closes the connection.
        slot: The visitor whose slot the connection has; None while it is on probation.
    """

    who: Visitor
    close: Callable[[], None]
    slot: Visitor | None = None


class ConnectionLimiter:
    """Limits connections per address or token subject. Local programs are not limited.

    A connection is on probation until `hello`. Each address may have `PROBATION_FACTOR` times
    `limit` connections on probation; one more replaces the oldest. With `hello`, a connection takes
    one of the `limit` slots of its address or, with a token, of its subject. An IPv6 /48 network
    may have `SITE_FACTOR` times `limit` connections on probation, and as many slots.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._waiting: dict[str, dict[CountedConnection, None]] = {}
        self._slots: Counter[str] = Counter()

    def arrive(self, connection: CountedConnection) -> None:
        """Add a connection on probation, and close the oldest one if there are too many."""
        if connection.who.local:
            return
        for name, limit in self._limits(connection.who, PROBATION_FACTOR):
            waiting = self._waiting.setdefault(name, {})
            waiting[connection] = None
            if len(waiting) > limit:
                # The oldest goes, not the newest: connections that never send `hello` must not lock
                # out new clients of the same address.
                oldest = next(iter(waiting))
                self._leave_probation(oldest)
                oldest.close()

    def admit(
        self,
        connection: CountedConnection,
        who: Visitor,
        instead_of: CountedConnection | None = None,
    ) -> None:
        """Give a connection a slot of `who`, or the slot of the connection that it replaces.

        Raises:
            TooManyConnectionsError: All slots are taken.
        """
        if who.local:
            return
        # The slot of an earlier `hello` that was refused for another reason.
        self.release(connection)
        # A returning client replaces its own connection, which the server may not know to be dead
        # yet. Without this, a client at the limit could not come back.
        replaced = instead_of.slot if instead_of is not None else None
        if instead_of is not None and replaced is not None and replaced.group == who.group:
            self.release(instead_of)
        for name, limit in self._limits(who):
            if self._slots[name] >= limit:
                whose = f"your network {name} has" if name == who.site else "you have"
                text = f"{whose} {limit} connections already; close one of them first"
                raise TooManyConnectionsError("rate/connections", text)
        self._slots.update(name for name, _ in self._limits(who))
        connection.slot = who

    def release(self, connection: CountedConnection) -> None:
        """Free the slot of a connection that is closed or was replaced."""
        self._leave_probation(connection)
        slot, connection.slot = connection.slot, None
        if slot is not None:
            for name, _ in self._limits(slot):
                self._slots[name] -= 1
                if self._slots[name] <= 0:
                    del self._slots[name]

    def _limits(self, who: Visitor, factor: int = 1) -> list[tuple[str, int]]:
        """Return the names under which a visitor counts, each with its limit."""
        limits = [(who.group, factor * self._limit)]
        return [*limits, (who.site, SITE_FACTOR * self._limit)] if who.site else limits

    def _leave_probation(self, connection: CountedConnection) -> None:
        for name, _ in self._limits(connection.who):
            waiting = self._waiting.get(name)
            if waiting is not None:
                waiting.pop(connection, None)
                if not waiting:
                    del self._waiting[name]

    @property
    def groups(self) -> int:
        """Number of remembered groups; never more than two for each connection."""
        return len(self._waiting) + len(self._slots)


class CodeGuessLimiter:
    """Limits wrong join codes, so that codes cannot be guessed.

    Each group (an address or token subject) may send `burst` wrong codes and regains one every
    `60 / burst` seconds. At most `capacity` groups are remembered. Groups with a full budget are
    forgotten first, then those whose last wrong code is oldest.
    """

    def __init__(self, burst: int = WRONG_CODES_A_MINUTE, capacity: int = 10_000) -> None:
        self._burst = burst
        self._capacity = capacity
        self._budgets: OrderedDict[str, TokenBucket] = OrderedDict()

    def check(self, who: Visitor, now: float) -> None:
        """Raise ProtocolError `rate/codes` if a visitor has sent too many wrong codes."""
        budget = self._budgets.get(who.group)
        # Local programs may list all episodes anyway.
        if budget is not None and not who.local and budget.left(now) < 1:
            text = "too many wrong codes; try again in a minute"
            raise ProtocolError("rate/codes", text, "episode")

    def wrong(self, who: Visitor, now: float) -> None:
        """Count a wrong code."""
        if who.local:
            return
        # Reinserted at the end, so the first entry is always the one whose last wrong code is
        # oldest.
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
