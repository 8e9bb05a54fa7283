"""nginx and Caddy processes, configured as in the operations guide, in front of a server."""

from __future__ import annotations

import os
import shutil
import ssl
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest
import trustme
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.client import connect as open_socket
from websockets.typing import Subprotocol

from tests.support.pages import titled

__all__ = ["NAME", "PROXIES", "Front", "Proxy", "front_door", "mint", "program"]

PAGE = "operate_a_server.md"
NAME = "kitchen.example.org"
"""Name of the guide's site. Proxies answer under it and under `localhost`."""
PATIENCE = 30.0
"""Seconds to wait until a process listens."""
MINT = (sys.executable, "-c", "from robotouille_server.auth.token_cli import main; main()")


@dataclass(frozen=True)
class Front:
    """Public URL of a proxy, and the certificate authority that clients trust."""

    url: str
    authority: Path

    @contextmanager
    def trusted(self) -> Iterator[None]:
        """Make the client library trust the authority."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("SSL_CERT_FILE", str(self.authority))
            yield

    async def knock(self, source: str) -> ClientConnection:
        """Open a connection from another address of this machine."""
        return await open_socket(
            self.url,
            ssl=self._tls(),
            subprotocols=[Subprotocol("robotouille.v1.json")],
            local_addr=(source, 0),
        )

    def get(self, path: str) -> Any:
        """Return the response to a GET request."""
        url = self.url.replace("wss://", "https://") + path
        return urlopen(url, timeout=5, context=self._tls())

    def _tls(self) -> ssl.SSLContext:
        return ssl.create_default_context(cafile=str(self.authority))


Proxy = Callable[[Path, int, int, int], AbstractContextManager[Front]]
"""Function that starts a proxy: folder, port, server's port, number of workers."""


def program(name: str) -> str | None:
    """Return the path of a proxy, which may be outside the user's PATH."""
    return shutil.which(name, path=f"{os.environ.get('PATH', os.defpath)}{os.pathsep}/usr/sbin")


def front_door(port: int) -> str:
    """Return the URL of a proxy on a port."""
    return f"wss://localhost:{port}"


def mint(role: str, subject: str, recordings: Path) -> str:
    """Create a token with the command in the guide."""
    keys = recordings.with_name(f"{recordings.name}.state") / "keys.json"
    arguments = [*MINT, "mint", role, "--subject", subject, "--keys", str(keys)]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


# nginx

NGINX = """
daemon off;
master_process off;
pid {folder}/nginx.pid;
error_log stderr;
events {{}}
http {{
    access_log off;
    client_body_temp_path {folder}/body;
    proxy_temp_path {folder}/proxy;
    fastcgi_temp_path {folder}/fastcgi;
    uwsgi_temp_path {folder}/uwsgi;
    scgi_temp_path {folder}/scgi;
{site}
}}
"""
"""Minimal nginx configuration around the guide's site."""


@contextmanager
def nginx(folder: Path, port: int, behind: int, workers: int) -> Iterator[Front]:
    """Run nginx with the guide's site, including the workers' locations."""
    authority = trustme.CA()
    authority.cert_pem.write_to_path(str(folder / "authority.pem"))
    issued = authority.issue_cert("localhost", NAME)
    issued.private_key_pem.write_to_path(str(folder / "privkey.pem"))
    for number, blob in enumerate(issued.cert_chain_pems):
        blob.write_to_path(str(folder / "fullchain.pem"), append=number > 0)
    (folder / "nginx.conf").write_text(NGINX.format(folder=folder, site=_site(workers)))
    _change(
        folder / "nginx.conf",
        {
            "listen 443 ssl": f"listen 127.0.0.1:{port} ssl",
            f"{NAME};": f"localhost {NAME};",
            f"/etc/letsencrypt/live/{NAME}": str(folder),
            **_ports(behind, workers),
        },
    )
    config = str(folder / "nginx.conf")
    command = [str(program("nginx")), "-p", str(folder), "-e", "stderr", "-c", config]
    (folder / "proxy_headers.conf").write_text(_proxy_headers())
    with _running(command, folder, Front(front_door(port), folder / "authority.pem")) as front:
        yield front


def _site(workers: int) -> str:
    """Return the guide's site, with the workers' locations if there are several workers."""
    site = titled(PAGE, "nginx")
    if workers == 1:
        return site
    opening = "    location / {"
    assert site.count(opening) == 1
    return site.replace(opening, titled(PAGE, "nginx, in the server above") + opening)


def _proxy_headers() -> str:
    """Return the lines after `proxy_pass` in the guide's site."""
    after = titled(PAGE, "nginx").split("proxy_pass http://robotouille;")[1]
    return after.split("}")[0]


# Caddy

CADDY = """{{
    admin off
    auto_https disable_redirects
    skip_install_trust
    storage file_system {folder}/storage
    log {{
        level ERROR
    }}
}}
{site}
"""


@contextmanager
def caddy(folder: Path, port: int, behind: int, workers: int) -> Iterator[Front]:
    """Run Caddy with the guide's file and a certificate of Caddy's own authority."""
    site = titled(PAGE, "Caddyfile" if workers == 1 else "Caddyfile, with workers")
    (folder / "Caddyfile").write_text(CADDY.format(folder=folder, site=site))
    _change(
        folder / "Caddyfile",
        {
            f"{NAME} {{": f"localhost:{port}, {NAME}:{port} {{\n    tls internal",
            **_ports(behind, workers),
        },
    )
    config = str(folder / "Caddyfile")
    command = [str(program("caddy")), "run", "--config", config, "--adapter", "caddyfile"]
    authority = folder / "storage/pki/authorities/local/root.crt"
    with _running(command, folder, Front(front_door(port), authority)) as front:
        yield front


PROXIES: dict[str, Proxy] = {"nginx": nginx, "caddy": caddy}

# Both


def _ports(behind: int, workers: int) -> dict[str, str]:
    """Map the guide's addresses of the server and its workers to the real ones."""
    count = 1 if workers == 1 else workers + 1
    return {f"127.0.0.1:{8765 + i}": f"127.0.0.1:{behind + i}" for i in range(count)}


def _change(file: Path, changes: dict[str, str]) -> None:
    """Replace texts in a file; each must occur."""
    text = file.read_text()
    for old, new in changes.items():
        assert text.count(old) > 0, f"the guide no longer has {old!r}"
        text = text.replace(old, new)
    file.write_text(text)


@contextmanager
def _running(command: list[str], folder: Path, front: Front) -> Iterator[Front]:
    """Run a process until the context exits, and wait until it reaches the server."""
    log = folder / "proxy.log"
    environment = {**os.environ, "HOME": str(folder), "XDG_CONFIG_HOME": str(folder)}
    with log.open("w") as output:
        process = subprocess.Popen(command, stdout=output, stderr=output, env=environment)
    try:
        _await_health(front, process, log)
        yield front
    finally:
        process.kill()
        process.wait()


def _await_health(front: Front, process: subprocess.Popen[bytes], log: Path) -> None:
    end = time.monotonic() + PATIENCE
    fault: OSError | None = None
    while time.monotonic() < end and process.poll() is None:
        try:
            with front.get("/healthz") as answer:
                assert answer.read() == b"ok\n"
            return
        except OSError as error:
            fault = error
        time.sleep(0.02)
    raise AssertionError(f"no way through to the server: {fault}\n{log.read_text()}")
