"""The browser client on the port of the WebSocket, and the sites that may connect.

A browser on someone's machine also runs pages of other sites. The server answers browsers only
under names that are its own, which stops DNS rebinding, and accepts WebSockets only from its own
pages and those of `--origins`. A page never counts as a local program, so without a token it is a
player.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from http import HTTPStatus
from urllib.parse import urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Response

from robotouille.web import WebFile, WebSite
from robotouille_server.auth import AccessSettingError, is_address

PAGES = ("/play", "/watch")
"""Addresses of the page. The part after `#` has the code of a kitchen."""
FILES = "/play/"
YEAR = 365 * 24 * 3600
_HOST = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(?::(\d{1,5}))?")
_ORIGIN = re.compile(f"(https?)://{_HOST.pattern}")
_NAME = re.compile(r"[a-z0-9]([a-z0-9.-]{0,250}[a-z0-9])?")
_DEFAULT_PORTS = {"http": 80, "https": 443}


def parse_names(text: str) -> frozenset[str]:
    """Parse a list of host names, such as `kitchen.example.org,node2.example.org`.

    Raises:
        AccessSettingError: A name is invalid, or has a scheme or port.
    """
    names = frozenset(part.strip().lower() for part in text.split(",") if part.strip())
    for name in sorted(names):
        if not is_host_name(name):
            raise AccessSettingError(
                f"--page-names: {name!r} is not a host name; expected names without scheme and "
                "port, such as kitchen.example.org"
            )
    return names


def is_host_name(text: str) -> bool:
    """Return whether a text is a host name, without a port."""
    return _NAME.fullmatch(text.lower()) is not None


class OwnSite:
    """Names and ports of this server, as browsers see them.

    Args:
        names: Host names of the server, and of the nodes and proxies that belong to it.
        ports: Ports of the server and its workers.
        parents: Origins of pages that may show the page in a frame.
    """

    def __init__(
        self, names: Iterable[str], ports: Iterable[int], parents: Collection[str] = ()
    ) -> None:
        self.names = set(names)
        self.ports = set(ports)
        self.parents = tuple(sorted(parents))

    def host(self, headers: Headers) -> str | None:
        """Return the name in `Host` if it is one of this server; otherwise None.

        IP addresses and `localhost` always count, because no other site can use them as its name.
        """
        found = _HOST.fullmatch(",".join(headers.get_all("Host")))
        name = found[1].lower() if found else ""
        if name == "localhost" or is_address(name.strip("[]")) or name in self.names:
            return name
        return None

    def has_page(self, headers: Headers) -> bool:
        """Return whether a request comes from a page of this server."""
        origins, host = headers.get_all("Origin"), self.host(headers)
        origin = _ORIGIN.fullmatch(origins[0].lower()) if len(origins) == 1 else None
        if origin is None or host is None:
            return False
        scheme, name, port = origin[1], origin[2], int(origin[3] or _DEFAULT_PORTS[origin[1]])
        if name in self.names and (port in self.ports or port == _DEFAULT_PORTS[scheme]):
            return True
        given = _HOST.fullmatch(headers["Host"])
        here = int(given[2]) if given and given[2] else _DEFAULT_PORTS[scheme]
        return name == host and (port == here or port in self.ports)

    def policy(self, host: str) -> str:
        """Return the page's content security policy under one of the names."""
        # `'self'` is the page's own port; workers and nodes have others. IPv6 addresses are not
        # allowed in a policy.
        names = sorted(name for name in {host, *self.names} if not name.startswith("["))
        parents = " ".join(self.parents) or "'none'"
        sockets = " ".join(f"ws://{name}:* wss://{name}:*" for name in names)
        return (
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
            f"connect-src 'self' {sockets}; base-uri 'none'; form-action 'none'; "
            f"frame-ancestors {parents}"
        )


def parse_consent(text: str) -> str:
    """Return the address of the information about a study, which may be empty.

    Raises:
        AccessSettingError: The text is not the address of a web page.
    """
    try:
        parts = urlsplit(text)
    except ValueError:
        parts = urlsplit("")
    if text and not (parts.scheme in ("http", "https") and parts.hostname):
        raise AccessSettingError(
            f"--page-consent: {text!r} is not the address of a web page; expected https://HOST/PATH"
        )
    return text


class WebPages:
    """Answers requests for the page and its files.

    Args:
        site: The files.
        own: The names of the server.
        consent: Address of the information to which people agree before they play.
    """

    def __init__(self, site: WebSite, own: OwnSite, consent: str = "") -> None:
        self._site = site
        self._own = own
        self._page = site.page(consent)

    def answer(self, path: str, headers: Headers) -> Response | None:
        """Return the answer to a request; None if the path is not one of the page's."""
        if path not in PAGES and not path.startswith(FILES):
            return None
        host = self._own.host(headers)
        if host is None:
            given = ", ".join(headers.get_all("Host"))[:100]
            return _text(
                HTTPStatus.MISDIRECTED_REQUEST,
                f"The host {given!r} is not allowed; its operator can add it with --page-names.\n",
            )
        if path in PAGES:
            page = _file(self._page, headers, "no-cache")
            page.headers["Content-Security-Policy"] = self._own.policy(host)
            if not self._own.parents:
                # For browsers that do not know `frame-ancestors`.
                page.headers["X-Frame-Options"] = "DENY"
            return page
        version, _, name = path.removeprefix(FILES).partition("/")
        # An old version's address must not show a new file, which browsers would keep.
        found = self._site.find(name) if version == self._site.version else None
        if found is None:
            return _text(HTTPStatus.NOT_FOUND, "no such file; reload the page\n")
        keep = f"public, max-age={YEAR}, immutable"
        return _file(found, headers, keep)


def _file(file: WebFile, headers: Headers, keep: str) -> Response:
    accepted = ",".join(headers.get_all("Accept-Encoding")).lower()
    packed = re.search(r"(^|[\s,])gzip\s*(,|;\s*q=(1|0\.0*[1-9])|$)", accepted) is not None
    body = file.packed if packed else file.content
    response = _response(HTTPStatus.OK, file.kind, body)
    if packed:
        response.headers["Content-Encoding"] = "gzip"
    response.headers["Vary"] = "Accept-Encoding"
    response.headers["Cache-Control"] = keep
    return response


def _text(status: HTTPStatus, text: str) -> Response:
    response = _response(status, "text/plain; charset=utf-8", text.encode())
    response.headers["Cache-Control"] = "no-store"
    return response


def _response(status: HTTPStatus, kind: str, body: bytes) -> Response:
    headers = Headers(
        {
            "Connection": "close",
            "Content-Length": str(len(body)),
            "Content-Type": kind,
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
        }
    )
    return Response(status.value, status.phrase, headers, body)
