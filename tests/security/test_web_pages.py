"""The browser client's files, the names of a server, and the pages that may connect."""

from __future__ import annotations

import asyncio
import gzip
from pathlib import Path

import pytest
from websockets.datastructures import Headers

from robotouille_server import Server
from robotouille_server.auth import AccessSettingError
from robotouille_server.web_pages import OwnSite, parse_consent
from tests.support.handshakes import hello, opened, status
from tests.support.servers import serving
from tests.support.virtual_time import virtual

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self' ws://127.0.0.1:* wss://127.0.0.1:*; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'"
)


async def get(server: Server, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
    """Return the status, headers and body of a request."""
    reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
    sent = {"Host": f"127.0.0.1:{server.port}", **headers}
    lines = [f"GET {path} HTTP/1.1", *(f"{name}: {value}" for name, value in sent.items())]
    writer.write("\r\n".join([*lines, "", ""]).encode())
    head, _, body = (await reader.read()).partition(b"\r\n\r\n")
    writer.close()
    first, *rest = head.decode().split("\r\n")
    found = dict(line.split(": ", 1) for line in rest)
    return int(first.split()[1]), {name.lower(): value for name, value in found.items()}, body


@virtual
async def test_page_names_files_that_browsers_keep(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        for path in ("/play", "/watch?lang=de"):
            code, headers, body = await get(server, path)
            assert (code, headers["cache-control"]) == (200, "no-cache")
        assert headers["content-security-policy"] == POLICY
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["x-frame-options"] == "DENY"
        assert b"<script>" not in body
        names = [part.split(b'"')[0].decode() for part in body.split(b'="play/')[1:]]
        assert {name.partition("/")[2] for name in names} == {
            "icon.svg", "looks/robotouille.json", "page.css", "pictures/kitchen.json",
            "play/bundle.js",
        }  # fmt: skip
        for name in [*names, f"{names[0].partition('/')[0]}/rules/task.js"]:
            code, headers, plain = await get(server, f"/play/{name}")
            assert code == 200 and "immutable" in headers["cache-control"]
            packed_as = {"Accept-Encoding": "br, gzip"}
            _, headers, packed = await get(server, f"/play/{name}", **packed_as)
            assert headers["content-encoding"] == "gzip"
            assert gzip.decompress(packed) == plain


@virtual
async def test_other_files_and_old_versions_are_not_served(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        _, _, body = await get(server, "/play")
        version = body.split(b"play/")[1].split(b"/")[0].decode()
        for name in (
            f"{version}/../site.py", f"{version}/%2e%2e/site.py", f"{version}/", "0/page.css",
            f"{version}//etc/passwd", f"{version}/looks/nothing.json",
        ):  # fmt: skip
            code, headers, _ = await get(server, f"/play/{name}")
            assert (code, headers["cache-control"]) == (404, "no-store"), name


@virtual
async def test_page_is_shown_under_the_servers_own_names_only(tmp_path: Path) -> None:
    async with serving(tmp_path, page_names="kitchen.example.org, Other.example") as server:
        for host in ("localhost", "[::1]:80", "192.0.2.7", "KITCHEN.example.org:8443"):
            assert (await get(server, "/play", Host=host))[0] == 200, host
        for host in ("evil.example", "kitchen.example.org.evil.example", "a b", "127.0.0.1@evil"):
            code, _, body = await get(server, "/play", Host=host)
            assert code == 421 and b"--page-names" in body, host


@virtual
async def test_page_may_be_framed_by_the_named_sites_only(tmp_path: Path) -> None:
    async with serving(
        tmp_path, page_parents="https://Lab.example, http://localhost:3000"
    ) as server:
        _, headers, _ = await get(server, "/play")
        policy = headers["content-security-policy"]
        assert policy.endswith("frame-ancestors http://localhost:3000 https://lab.example")
        assert "x-frame-options" not in headers
        framing = {"Origin": "https://lab.example"}
        assert (await status(server, **framing))[0] == 403, "the parent itself may not connect"


@virtual
async def test_address_of_the_consent_is_escaped(tmp_path: Path) -> None:
    url = 'https://lab.example/info?a=1&b="><script>'
    async with serving(tmp_path, page_consent=url) as server:
        _, _, body = await get(server, "/play")
        named = b"https://lab.example/info?a=1&amp;b=&quot;&gt;&lt;script&gt;"
        assert b'<meta name="consent" content="' + named + b'">' in body


@pytest.mark.parametrize("url", ["javascript:alert(1)", "info.html", "https://", "http://[1"])
def test_consent_must_be_a_web_page(url: str) -> None:
    with pytest.raises(AccessSettingError, match=r"--page-consent: .* is not the address of a web"):
        parse_consent(url)


@virtual
async def test_server_without_the_page_refuses_its_origin(tmp_path: Path) -> None:
    async with serving(tmp_path, page=False) as server:
        assert (await get(server, "/play"))[0] == 426
        own = f"http://127.0.0.1:{server.port}"
        assert (await status(server, Origin=own))[0] == 403


@pytest.mark.parametrize(
    ("path", "headers", "code"),
    [
        ("/healthz", {}, 200),
        ("/no-page", {}, 426),
        ("/", {"Upgrade": "websocket", "Connection": "Upgrade"}, 400),
        ("/", {"Upgrade": "websocket", "Origin": "http://evil.example"}, 403),
    ],
)
@virtual
async def test_browsers_guess_no_type_of_plain_answers(
    tmp_path: Path, path: str, headers: dict[str, str], code: int
) -> None:
    async with serving(tmp_path) as server:
        found, received, _ = await get(server, path, **headers)
        assert (found, received.get("x-content-type-options")) == (code, "nosniff")


@virtual
async def test_own_page_is_a_player_even_on_this_machine(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        async with opened(server, Origin=f"http://127.0.0.1:{server.port}") as page:
            assert (await hello(page))["role"] == "player"
            refused = await page.ask({"type": "list"}, "episodes")
            assert refused["code"] == "auth/role"
        async with opened(server) as program:
            assert (await hello(program))["role"] == "host"


@virtual
async def test_pages_of_other_sites_may_not_connect(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        own = f"127.0.0.1:{server.port}"
        for headers in (
            {"Origin": "http://evil.example"},
            {"Origin": "http://127.0.0.1:1"},
            {"Origin": "null"},
            {"Origin": f"http://{own}.evil.example"},
            {"Origin": f"http://evil.example#{own}"},
            {"Origin": f"http://user@{own}"},
            {"Origin": f"ftp://{own}"},
            {"Origin": f"http://{own}, http://evil.example"},
            # A name that was rebound to this machine.
            {"Origin": "http://evil.example", "Host": "evil.example"},
        ):
            assert (await status(server, **headers))[0] == 403, headers


OWN = OwnSite(["kitchen.example.org", "node2.example.org"], [8765, 9001])


@pytest.mark.parametrize(
    ("origin", "host", "own"),
    [
        ("https://kitchen.example.org", "kitchen.example.org", True),
        ("https://kitchen.example.org", "node2.example.org:8765", True),
        ("http://localhost:8765", "localhost:9001", True),
        ("http://localhost:8080", "localhost:8080", True),
        ("http://[::1]:8765", "[::1]:9001", True),
        ("http://localhost:3000", "localhost:8765", False),
        ("http://localhost:8765", "127.0.0.1:8765", False),
        ("https://kitchen.example.org", "evil.example", False),
        ("https://other.example.org", "kitchen.example.org", False),
        ("http://localhost:99999", "localhost:8765", False),
        ("http://[::1", "localhost:8765", False),
        ("http://localhost", "localhost", True),
    ],
)
def test_pages_on_all_ports_and_names_of_the_server_are_its_own(
    origin: str, host: str, own: bool
) -> None:
    assert OWN.has_page(Headers({"Origin": origin, "Host": host})) is own
