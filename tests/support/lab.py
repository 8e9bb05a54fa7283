"""The services of `docker-compose.yml` as local processes, with their files and environment.

Nothing runs in a container. A service's files are copied into its own folder, at the paths that
they have in the container, and host names and ports are mapped to this machine. `Lab.hosts` lists
the mappings; an unmapped or unused one is an error.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from tests.support.compose import compose
from tests.support.postgresql import USER as POSTGRES_USER
from tests.support.postgresql import program as postgresql_program
from tests.support.scripts import script_module
from tests.support.sources import ROOT
from tests.support.worker_processes import lasting_ports

__all__ = ["PROGRAMS", "Lab", "lab", "missing"]

PROGRAMS = ("mosquitto", "mosquitto_sub", "prometheus", "promtool", "caddy", "wget", "psql")
PYTHON = {
    "robotouille": "robotouille_client.cli.main",
    "robotouille-server": "robotouille_server.cli",
}
ENTRY_POINTS = {"prometheus": ["prometheus"]}
"""Words that an image puts before the command."""
NAMES = "server|mosquitto|postgres|catalogue|prometheus|grafana|caddy"
PORTS = (8765, 8766, 1883, 9001, 5432, 9090, 3000, 443, 80, 2020)
"""Ports of the containers."""
WHOLE = re.compile(rf"\b(?:{NAMES}):\d+\b|:(?:{'|'.join(map(str, PORTS))})\b")
"""Host names and ports of containers; texts must contain none after the mapping."""
SECONDS = 60


def missing() -> str:
    """Return why the lab cannot start here, or an empty string."""
    absent = [name for name in PROGRAMS if not _found(name)]
    if absent:
        return f"{', '.join(absent)}: not installed"
    if not postgresql_program("initdb"):
        return "PostgreSQL is not installed"
    return ""


def _found(name: str) -> str | None:
    return shutil.which(name, path=f"{os.environ.get('PATH', os.defpath)}{os.pathsep}/usr/sbin")


class Lab:
    """Lab in a folder; `port` maps container ports to local ports."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.user = POSTGRES_USER if os.geteuid() == 0 else None
        first = lasting_ports(len(PORTS))
        self.port = {port: first + number for number, port in enumerate(PORTS)}
        self._copy()
        variables = (folder / ".env").read_text().splitlines()
        self.content = compose(dict(line.split("=", 1) for line in variables))
        self.services: dict[str, dict[str, Any]] = self.content["services"]
        here = self.port
        self.hosts = {
            **{f"{name}:{port}": f"127.0.0.1:{here[port]}" for name, port in (
                ("server", 8765), ("mosquitto", 9001), ("grafana", 3000), ("postgres", 5432),
                ("127.0.0.1", 8765), ("127.0.0.1", 2020), ("127.0.0.1", 9090), ("0.0.0.0", 9090),
            )},
            "robotouille@postgres": f"robotouille@127.0.0.1:{here[5432]}",
            "reader@postgres": f"reader@127.0.0.1:{here[5432]}",
            "server@mosquitto": f"server@127.0.0.1:{here[1883]}",
            "listener 1883 0.0.0.0": f"listener {here[1883]} 127.0.0.1",
            "listener 9001 0.0.0.0": f"listener {here[9001]} 127.0.0.1",
            "admin off": f"admin off\n\thttp_port {here[80]}\n\thttps_port {here[443]}",
            "scrape_interval: 15s": "scrape_interval: 1s",
        }  # fmt: skip
        self.used: set[str] = set()
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def _copy(self) -> None:
        ignored = shutil.ignore_patterns("data", "secrets", "__pycache__")
        shutil.copytree(ROOT / "lab", self.folder / "lab", ignore=ignored)
        owner = (os.geteuid(), os.getegid())
        if self.user is not None:
            import pwd

            found = pwd.getpwnam(self.user)
            owner = (found.pw_uid, found.pw_gid)
        make_secrets: Any = script_module(ROOT / "lab/make_secrets.py")
        list(make_secrets.make(self.folder, f"{owner[0]}:{owner[1]}"))
        for name in ("lab", "lab/data", "lab/secrets"):
            (self.folder / name).chmod(0o711)

    # Files

    def root(self, name: str) -> Path:
        """Return the folder that serves as a container's root."""
        return self.folder / "roots" / name

    def place(self, name: str) -> None:
        """Put a service's files at the paths of its container."""
        service = self.services[name]
        for volume in service.get("volumes", []):
            source, inside = volume.split(":")[:2]
            target, found = self.root(name) / inside.strip("/"), self.folder / source
            target.parent.mkdir(parents=True, exist_ok=True)
            if source.startswith("./lab/data/"):
                target.symlink_to(found)
            elif found.is_file():
                self._copy_file(name, found, target)
        for secret in service.get("secrets", []):
            given = {"source": secret, "target": secret} if isinstance(secret, str) else secret
            inside = given["target"]
            inside = inside if inside.startswith("/") else f"/run/secrets/{inside}"
            found = self.folder / self.content["secrets"][given["source"]]["file"]
            self._copy_file(name, found, self.root(name) / inside.strip("/"))

    def _copy_file(self, name: str, found: Path, target: Path) -> None:
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(self.here(name, found.read_text()))
        target.chmod(found.stat().st_mode & 0o777)
        if self.user is not None and name not in ("server", "catalogue"):
            shutil.chown(target, self.user)

    def here(self, name: str, text: str) -> str:
        """Map the paths, hosts and ports in a container's text to local ones."""
        service = self.services[name]
        inside = {volume.split(":")[1] for volume in service.get("volumes", [])} | {"/run/secrets"}
        ordered = sorted(inside, key=len, reverse=True)
        pattern = re.compile(
            "|".join(rf"(?<![\w/.]){re.escape(path)}(?![\w-])" for path in ordered)
        )
        text = pattern.sub(lambda found: f"{self.root(name)}{found[0]}", text)
        for old, new in self.hosts.items():
            if re.search(rf"(?<![\w.]){re.escape(old)}(?![\w])", text):
                self.used.add(old)
                text = re.sub(rf"(?<![\w.]){re.escape(old)}(?![\w])", lambda _, new=new: new, text)
        comments = re.sub(r"^\s*#.*$", "", text, flags=re.MULTILINE)
        assert not WHOLE.search(comments), (name, WHOLE.search(comments))
        return text

    # Processes

    def environment(self, name: str) -> dict[str, str]:
        """Return the service's environment, with the variables needed to run it here."""
        given = {key: self.here(name, str(value)) for key, value in self._given(name).items()}
        return {**os.environ, "HOME": str(self.folder), **given}

    def _given(self, name: str) -> Mapping[str, Any]:
        given: dict[str, Any] = dict(self.services[name].get("environment", {}))
        if name == "server":
            image = re.findall(r"\b(ROBOTOUILLE_\w+)=(\S+)", (ROOT / "Dockerfile").read_text())
            given = {**dict(image), **given, "ROBOTOUILLE_PORT": str(self.port[8765])}
        return given

    def command(self, name: str, words: list[str]) -> list[str]:
        """Map a service's command to a local one."""
        first, *rest = [self.here(name, word) for word in words]
        if first in PYTHON:
            return [sys.executable, "-c", f"from {PYTHON[first]} import main; main()", *rest]
        if first == "python":
            return [sys.executable, *rest]
        port = {"mosquitto_sub": ["-p", 1883], "pg_isready": ["-p", 5432]}.get(first, [])
        here = [str(self.port.get(word, word)) for word in port]  # type: ignore[call-overload]
        return [_found(first) or postgresql_program(first) or first, *here, *rest]

    def start(self, name: str) -> None:
        """Start a service."""
        words = self.services[name].get("command") or self._image_command()
        words = [*ENTRY_POINTS.get(name, []), *words]
        if name == "postgres":
            data = self.root(name) / "var/lib/postgresql/data"
            words = [str(postgresql_program("postgres")), "-D", str(data), *self._address()]
        python = name in ("server", "catalogue")
        with (self.folder / f"{name}.log").open("ab") as log:
            self._processes[name] = subprocess.Popen(
                words if name == "postgres" else self.command(name, words),
                env=self.environment(name),
                cwd=self.folder,
                user=None if python else self.user,
                stdout=log,
                stderr=subprocess.STDOUT,
            )

    @staticmethod
    def _image_command() -> list[str]:
        (found,) = re.findall(r"^CMD (\[.*\])$", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
        words: list[str] = json.loads(found)
        return words

    def _address(self) -> list[str]:
        return ["-p", str(self.port[5432]), "-h", "127.0.0.1", "-k", str(self.folder), "-F"]

    def stop(self, name: str) -> None:
        """Stop a service like Compose: terminate it, and kill it after 30 seconds."""
        process = self._processes.pop(name)
        process.terminate()
        try:
            process.wait(timeout=30)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def await_end(self, name: str) -> int:
        """Wait until a service ends by itself and return its status."""
        return self._processes[name].wait(timeout=SECONDS)

    def log(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text(errors="replace")

    def health(self, name: str) -> bool:
        """Run a service's health check and return whether it passes."""
        kind, *words = self.services[name]["healthcheck"]["test"]
        assert kind == "CMD"
        command, environment = self.command(name, words), self.environment(name)
        done = subprocess.run(command, env=environment, capture_output=True, timeout=SECONDS)
        return done.returncode == 0

    def await_health(self, name: str) -> None:
        """Wait until a service's health check passes."""
        end = time.monotonic() + SECONDS
        while not self.health(name):
            assert self._processes[name].poll() is None, f"{name} has ended: {self.log(name)}"
            assert time.monotonic() < end, f"{name} is unhealthy: {self.log(name)}"
            time.sleep(0.1)

    def make_database(self) -> None:
        """Initialize the database like the PostgreSQL image on its first start."""
        root, given = self.root("postgres"), self.environment("postgres")
        data = str(root / "var/lib/postgresql/data")
        password = given["POSTGRES_PASSWORD_FILE"]
        made = ["--pgdata", data, "--username", given["POSTGRES_USER"], "--pwfile", password]
        words = [postgresql_program("initdb"), *made, *given["POSTGRES_INITDB_ARGS"].split(), "-N"]
        options = " ".join(self._address())
        script = root / "docker-entrypoint-initdb.d/roles.sh"
        local = {**given, "PGHOST": str(self.folder), "PGPORT": str(self.port[5432])}
        control = [postgresql_program("pg_ctl"), "--pgdata", data]
        log = ["--log", data + "/first.log"]
        for command in (
            words,
            [*control, "start", "--wait", "--options", options, *log],
            ["createdb", "--username", given["POSTGRES_USER"], given["POSTGRES_DB"]],
            ["sh", str(script)],
            [*control, "stop", "--mode=fast"],
        ):
            done = subprocess.run(
                command, env=local, cwd=self.folder, user=self.user, capture_output=True, text=True
            )
            assert done.returncode == 0, done.stderr

    def ask(self, query: str, user: str = "reader") -> subprocess.CompletedProcess[str]:
        """Query the catalogue with the user's password."""
        file = {"reader": "postgres_reader", "robotouille": "postgres_owner"}[user]
        password = (self.folder / "lab/secrets" / file).read_text()
        words = ["psql", "-h", "127.0.0.1", "-p", str(self.port[5432]), "-U", user, "-At"]
        return subprocess.run(
            [*words, "-c", query, "robotouille"],
            env={**os.environ, "PGPASSWORD": password},
            capture_output=True,
            text=True,
            timeout=SECONDS,
        )


@contextmanager
def lab(*names: str) -> Iterator[Lab]:
    """Run these services of the lab in order, and wait until each is healthy."""
    with tempfile.TemporaryDirectory(prefix="lab") as folder, ExitStack() as stack:
        Path(folder).chmod(0o711)
        made = Lab(Path(folder))
        if made.user is not None:
            shutil.chown(folder, made.user)
        for name in names:
            made.place(name)
            if name == "postgres":
                made.make_database()
            made.start(name)
            stack.callback(lambda name=name: name in made._processes and made.stop(name))
            made.await_health(name)
        yield made
