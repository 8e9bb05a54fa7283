"""Addresses of servers: lists of them, redirects, and the hosts that a client trusts."""

from __future__ import annotations

from collections.abc import Iterable
from urllib.parse import SplitResult, urlsplit, urlunsplit

from robotouille.protocol import messages
from robotouille_client.errors import UntrustedRedirectError

# Domains of a country below which anybody can register, such as co.uk.
REGISTRY_LABELS = frozenset({"ac", "co", "com", "edu", "gov", "ltd", "ne", "net", "or", "org"})


def split_addresses(urls: str) -> list[str]:
    """Return the addresses of a list that is separated by commas, each once."""
    parts = (part.strip() for part in urls.split(","))
    return list(dict.fromkeys(filter(None, parts))) or [urls]


def moved_url(
    url: str, moved: messages.Moved | messages.WorkerAddress, named: Iterable[str] = ()
) -> str:
    """Return the address of the server process that a message names.

    Args:
        url: The address of the connection.
        named: Addresses that the user named.

    Raises:
        UntrustedRedirectError: The address is on another host, or drops TLS.
    """
    parts = urlsplit(url)
    if moved.url:
        check_redirect(parts, moved.url, named)
        return moved.url
    # Without a URL the process is on the same host, behind another port.
    if not 0 < moved.port < 2**16:
        raise UntrustedRedirectError(f"{url} redirects to port {moved.port}, which is invalid")
    host = f"[{parts.hostname}]" if ":" in (parts.hostname or "") else parts.hostname
    return urlunsplit(parts._replace(netloc=f"{host}:{moved.port}"))


def check_redirect(current: SplitResult, url: str, named: Iterable[str] = ()) -> None:
    """Check that a client may send its tokens to the address of a redirect.

    Args:
        current: The address of the server that redirects.
        named: Addresses that the user named. Their hosts are trusted.

    Raises:
        UntrustedRedirectError: The address is invalid, drops TLS, or its host is neither named,
            nor the current one, nor (with TLS) in the same domain.
    """
    # A client sends its tokens to the address that it is redirected to. A faulty or hostile server
    # could otherwise have the tokens sent to a host that the user never chose.
    start = f"{current.scheme}://{current.netloc}"
    try:
        target = urlsplit(url)
        host, _ = target.hostname, target.port
    except ValueError:
        raise UntrustedRedirectError(
            f"{start} redirects to {url[:200]!r}, which is not an address"
        ) from None
    if target.scheme not in ("ws", "wss") or not host:
        raise UntrustedRedirectError(
            f"{start} redirects to {url[:200]!r}, which is not a ws:// or wss:// address"
        )
    if not _trusted(current, target, named):
        raise UntrustedRedirectError(
            f"{start} redirects to another host, {host!r}, and tokens are not sent there. "
            "If you trust that host, name its address in --url too"
        )
    if (current.scheme, target.scheme) == ("wss", "ws"):
        raise UntrustedRedirectError(
            f"{start} redirects to {target.netloc!r} without TLS, and tokens are not sent there"
        )


def _trusted(current: SplitResult, target: SplitResult, named: Iterable[str]) -> bool:
    if target.hostname in (current.hostname, *(urlsplit(each).hostname for each in named)):
        return True
    # Without certificates, the owner of a network decides where the names of a domain lead.
    if (current.scheme, target.scheme) != ("wss", "wss"):
        return False
    here, there = current.hostname or "", target.hostname or ""
    _, _, domain = there.partition(".")
    # The domain above the current host is trusted for other hosts, but not itself: otherwise, a
    # chain of redirects could climb to the top.
    return _is_domain(domain) and domain in (here, here.partition(".")[2])


def _is_domain(name: str) -> bool:
    """Return whether all hosts of a domain belong to one owner, as far as its name shows."""
    labels = name.split(".")
    if len(labels) < 2 or not all(labels) or labels[-1][0].isdigit():
        return False  # Numbers are the end of an IP address.
    country = len(labels) == 2 and len(labels[1]) == 2
    return not (country and labels[0] in REGISTRY_LABELS)
