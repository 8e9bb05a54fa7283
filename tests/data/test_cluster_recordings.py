"""Recordings of a cluster are copied from a real NATS server and indexed."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import json
import logging
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from queue import Queue
from typing import Any

import pytest
from typer.testing import CliRunner

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("nats", reason="needs the extra `cluster`")

import nats
from nats.js import JetStreamContext
from nats.js.api import ObjectMeta, ObjectMetaOptions

from robotouille.errors import MissingExtraError
from robotouille.nats.address import nats_address
from robotouille.replay.compression import compress
from robotouille.replay.container import MAX_FILE
from robotouille_client.cli.main import app
from robotouille_data import indexing
from robotouille_data.cluster_recordings import ClusterRecordings, Fetched
from robotouille_data.cluster_watching import ClusterOptions, fetching
from robotouille_data.database import UnavailableError, database_url
from robotouille_data.indexing import IndexResult, index, watch
from tests.support.nats import NatsCluster, missing, nats_cluster
from tests.support.random_play import random_stream

pytestmark = [
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(bool(missing()), reason=missing()),
]

STORE = "robotouille_recordings"
PATIENCE = 60.0


@pytest.fixture
def server(tmp_path: Path) -> Iterator[NatsCluster]:
    with nats_cluster(tmp_path / "nats", servers=1) as cluster:
        yield cluster


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    found = tmp_path / "copies"
    found.mkdir()
    return found


def recording(number: int) -> bytes:
    return compress(random_stream(number, steps=5))


def change(server: NatsCluster, change: Callable[[JetStreamContext], Any], **options: str) -> None:
    """Call a coroutine function with the JetStream of a server."""

    async def run() -> None:
        client = await nats.connect(server.url(0), **options)
        try:
            js = client.jetstream()
            await js.create_object_store(STORE)
            await change(js)
        finally:
            await client.close()

    asyncio.run(run())


def put(server: NatsCluster, files: dict[str, bytes], **options: str) -> None:
    """Store objects as nodes do."""

    async def store(js: JetStreamContext) -> None:
        objects = await js.object_store(STORE)
        for name, content in files.items():
            await objects.put(name, content)

    change(server, store, **options)


def copied(recordings: ClusterRecordings) -> Fetched:
    return recordings.fetch(threading.Event(), lambda: nullcontext(lambda done, total: None))


def test_recordings_are_copied_once_and_again_when_they_change(
    server: NatsCluster, folder: Path
) -> None:
    address = nats_address(server.url(0), "robotouille")
    contents = {f"game{i}.rbt": recording(i) for i in range(3)}
    put(server, contents)
    recordings = ClusterRecordings(address, folder)
    assert copied(recordings) == Fetched(3)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == contents
    assert copied(recordings) == Fetched()
    put(server, {"game1.rbt": recording(7), "game9.rbt": recording(9)})
    assert copied(recordings) == Fetched(2)
    assert (folder / "game1.rbt").read_bytes() == recording(7)
    # Another process finds the files in the folder.
    assert copied(ClusterRecordings(address, folder)) == Fetched()
    (folder / "game0.rbt").write_bytes(recording(7))
    assert copied(ClusterRecordings(address, folder)) == Fetched(1)


def test_long_recording_comes_in_many_messages(server: NatsCluster, folder: Path) -> None:
    content = bytes(range(256)) * 4096  # 1 MiB

    async def store(js: JetStreamContext) -> None:
        options = ObjectMeta(options=ObjectMetaOptions(max_chunk_size=1000))
        await (await js.object_store(STORE)).put("long.rbt", content, options)

    change(server, store)
    assert copied(ClusterRecordings(nats_address(server.url(0), "robotouille"), folder)).files == 1
    assert (folder / "long.rbt").read_bytes() == content


def test_files_of_deleted_objects_stay(server: NatsCluster, folder: Path) -> None:
    put(server, {"game.rbt": recording(1), "late.rbt": recording(2)})
    recordings = ClusterRecordings(nats_address(server.url(0), "robotouille"), folder)
    copied(recordings)

    async def delete(js: JetStreamContext) -> None:
        await (await js.object_store(STORE)).delete("game.rbt")

    change(server, delete)
    assert copied(recordings) == Fetched()
    assert (folder / "game.rbt").is_file()

    async def renew(js: JetStreamContext) -> None:
        await js.delete_object_store(STORE)

    change(server, renew)
    put(server, {"new.rbt": recording(3)})
    assert copied(recordings) == Fetched(1)


def description(name: str, **other: object) -> tuple[str, bytes]:
    found = {"name": name, "nuid": "A" * 22, "size": 4, "chunks": 1, "bucket": STORE, **other}
    found.setdefault("digest", "SHA-256=" + base64.urlsafe_b64encode(b"\0" * 32).decode())
    return name, json.dumps(found).encode()


def subject(name: str) -> str:
    return f"$O.{STORE}.M.{base64.urlsafe_b64encode(name.encode()).decode()}"


def digest(content: bytes) -> str:
    return "SHA-256=" + base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode()


HOSTILE = {
    "its content is incomplete or damaged": [
        description("missing.rbt"),
        description("short.rbt", nuid="short", size=1000, digest=digest(b"some content")),
        description("sum.rbt", nuid="short", size=12),
    ],
    "its content is longer than announced": [
        description("long.rbt", nuid="short", size=3, digest=digest(b"som")),
        description("many.rbt", nuid="empty", size=3, digest=digest(b"som")),
    ],
    "not the name of a closed recording": [
        description("../outside.rbt"),
        description("/etc/passwd"),
        description("open.rbt.part"),
        description("\x1b[2J.rbt"),
        description("-rf.rbt"),
        description("a" * 201 + ".rbt"),
        description("\ud800.rbt".encode("utf-8", "replace").decode()),
    ],
    "its description is invalid": [
        description("all.rbt", nuid=">"),
        description("star.rbt", nuid="*"),
        description("negative.rbt", size=-1),
        description("text.rbt", size="4"),
        description("true.rbt", size=True),
        description("list.rbt", nuid=["x"]),
    ],
    "its description is not a JSON object": [
        ("deep.rbt", b"[" * 50_000),
        ("none.rbt", b"null"),
        ("number.rbt", b'{"size": ' + b"9" * 5000 + b"}"),
        ("latin.rbt", b'{"name": "\xff"}'),
        ("empty.rbt", b""),
    ],
    "its description is too long": [("wordy.rbt", b" " * 100_000)],
    f"larger than {MAX_FILE:,} bytes": [description("large.rbt", size=MAX_FILE + 1)],
    "no SHA-256": [description("md5.rbt", digest="MD5=x")],
    "a link to another object": [description("link.rbt", options={"link": {"bucket": "other"}})],
    "its name differs from that of its subject": [
        ("other.rbt", description("good.rbt")[1]),
        ("nameless.rbt", b"{}"),
    ],
}


def test_hostile_objects_are_refused_and_others_copied(
    server: NatsCluster, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robotouille_data.cluster_recordings.MAX_CHUNKS", 5)
    put(server, {"first.rbt": recording(1)})

    async def attack(js: JetStreamContext) -> None:
        for piece in (b"some ", b"content"):
            await js.publish(f"$O.{STORE}.C.short", piece)
        for _ in range(10):
            await js.publish(f"$O.{STORE}.C.empty", b"")
        for name, data in (each for some in HOSTILE.values() for each in some):
            await js.publish(subject(name), data)

    change(server, attack)
    put(server, {"good.rbt": recording(2), "broken.rbt": b"not a recording"})
    recordings = ClusterRecordings(nats_address(server.url(0), "robotouille"), folder)
    found = copied(recordings)
    assert found.files == 3
    names = {name: fault for fault, some in HOSTILE.items() for name, _ in some}
    long = "a" * 201 + ".rbt"
    names[f"{long[:200]}…"] = names.pop(long)
    assert found.faults == names
    assert {path.name for path in folder.iterdir()} == {"first.rbt", "good.rbt", "broken.rbt"}
    assert {path.name for path in folder.parent.iterdir()} == {"nats", "copies"}
    assert copied(recordings) == Fetched()
    result = index(database_url(None, folder), [folder])
    assert (result.indexed, list(result.faults)) == (2, [str(folder / "broken.rbt")])


def test_unknown_cluster_and_silent_server_are_reported(server: NatsCluster, folder: Path) -> None:
    recordings = ClusterRecordings(nats_address(server.url(0), "other"), folder)
    with pytest.raises(UnavailableError, match="no object store other_recordings"):
        copied(recordings)
    server.kill(0)
    with pytest.raises(UnavailableError, match="cannot connect to NATS at nats://127"):
        copied(recordings)


def test_user_needs_the_password_of_the_file(tmp_path: Path, folder: Path) -> None:
    lines = ["authorization { user: lab, password: right }"]
    with nats_cluster(tmp_path / "nats", servers=1, options=lines) as server:
        put(server, {"game.rbt": recording(1)}, user="lab", password="right")
        url = server.url(0).replace("//", "//lab@")
        for password, good in (("wrong", False), ("right", True)):
            file = tmp_path / password
            file.write_text(f"{password}\n")
            file.chmod(0o600)
            address = nats_address(url, "robotouille", password_file=file)
            if good:
                assert copied(ClusterRecordings(address, folder)) == Fetched(1)
                continue
            with pytest.raises(UnavailableError, match="Authorization"):
                copied(ClusterRecordings(address, folder))


@contextmanager
def watched(options: ClusterOptions, folder: Path) -> Iterator[Queue[IndexResult | str]]:
    """Watch a cluster in a thread, and yield the queue of reports."""
    reports: Queue[IndexResult | str] = Queue()
    stop = threading.Event()

    def run() -> None:
        watch(
            database_url(None, folder), [folder], stop, interval=0.02,
            fetch=fetching(options, folder, stop), report=reports.put,
            trouble=lambda words, _: reports.put(words),
        )  # fmt: skip

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield reports
    finally:
        stop.set()
        thread.join(PATIENCE)
        assert not thread.is_alive()


def test_watch_continues_after_a_restart_of_nats(
    server: NatsCluster,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(indexing, "MAX_PAUSE", 0.05)
    put(server, {"first.rbt": recording(1)})
    with watched(ClusterOptions(cluster=server.url(0)), folder) as reports:

        def until_known(count: int) -> None:
            while True:
                found = reports.get(timeout=PATIENCE)
                if isinstance(found, IndexResult) and found.indexed + found.unchanged == count:
                    return

        until_known(1)
        put(server, {"second.rbt": recording(2)})
        until_known(2)
        server.kill(0)
        while not isinstance(found := reports.get(timeout=PATIENCE), str):
            pass
        assert "NATS" in found
        server.start(0)
        server.wait()
        put(server, {"third.rbt": recording(3)})
        until_known(3)
    printed = capsys.readouterr()
    assert printed.out == "copied 1\n" * 3
    assert printed.err == "connected to NATS again\n"


def test_warnings_of_the_event_loop_are_not_printed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With TLS, the NATS library causes one at the end of each connection."""
    logger = logging.getLogger("asyncio")
    monkeypatch.setattr(logger, "level", logging.WARNING)
    fetching(ClusterOptions(cluster="tls://localhost"), folder, threading.Event())
    assert not logger.isEnabledFor(logging.WARNING)
    logger.setLevel(logging.WARNING)  # This also clears the cache of `isEnabledFor`.


def test_missing_extra_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "nats", None)
    monkeypatch.setitem(sys.modules, "nats.aio.client", None)
    monkeypatch.delitem(sys.modules, "robotouille_data.cluster_recordings")
    with pytest.raises(MissingExtraError, match="cluster"):
        fetching(ClusterOptions(cluster="nats://localhost"), folder, threading.Event())


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        ([], "give folders of recordings, or a cluster with --cluster"),
        (["FOLDER", "--cluster", "nats://x"], "give either folders or a cluster"),
        (["--cluster", "http://x"], "'http://x' is not nats://"),
        (["--cluster", "nats://a:b@x"], "the password in a file"),
        (["--cluster", "nats://x", "--cluster-name", "a b"], "--cluster-name a b"),
        (["--cluster", "nats://x", "--cluster-password-file", "none"], "no such file"),
        (["--cluster", "nats://x", "--cluster-ca", "none"], "--cluster-ca: none"),
    ],
)
def test_wrong_options_are_refused(
    arguments: list[str], fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["data", "watch", *arguments])
    assert (result.exit_code, result.stdout) == (1, "")
    assert fault in result.stderr


def test_copies_are_next_to_the_catalogue(tmp_path: Path) -> None:
    options = ClusterOptions(cluster_name="lab")
    assert options.folder(None) == Path("lab_recordings")
    assert options.folder(str(tmp_path / "c.sqlite")) == tmp_path / "lab_recordings"
    assert options.folder("postgresql://me@here/db") == Path("lab_recordings")
    assert ClusterOptions(into=tmp_path).folder(None) == tmp_path
