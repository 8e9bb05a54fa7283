"""TLS with a certificate that changes while the server runs."""

from __future__ import annotations

import asyncio
import asyncio.sslproto
import gc
import json
import os
import ssl
import sys
import threading
import tracemalloc
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import trustme
from cryptography.hazmat.primitives import serialization
from websockets.asyncio.client import connect

from robotouille_client import Client
from robotouille_client.errors import ConnectionFailedError
from robotouille_server.auth import Role
from robotouille_server.cli import _greeting, first_room
from robotouille_server.transport.admission import FAIR_SECONDS, HANDSHAKES_AT_ONCE, Newcomers
from robotouille_server.transport.connection import Connection
from robotouille_server.transport.loop_budget import LoopBudget
from robotouille_server.transport.tls import (
    MAX_PEM_BYTES,
    POLL_SECONDS,
    ServerTLS,
    TLSFileError,
    certificate_names,
)
from robotouille_server.transport.tls_records import HANDSHAKE, RECORDS_AT_A_TIME, RecordMeter
from tests.support.certificates import Pair, replace
from tests.support.client_hello import slow_hello
from tests.support.fuzzing.wire import frame, request
from tests.support.handshakes import mint_token
from tests.support.servers import serving
from tests.support.virtual_time import run, virtual


@pytest.fixture
def pair(tmp_path: Path) -> Pair:
    return Pair(tmp_path)


@asynccontextmanager
async def secure_server(pair: Pair) -> AsyncIterator[str]:
    async with serving(pair.cert.parent / "r", tls_cert=pair.cert, tls_key=pair.key) as server:
        yield server.url


def serial(connection: object) -> str:
    found = connection.transport.get_extra_info("peercert")  # type: ignore[attr-defined]
    return str(found["serialNumber"])


async def serial_now(url: str, pair: Pair) -> str:
    async with connect(url, ssl=pair.client()) as connection:
        return serial(connection)


@virtual
async def test_renewed_certificate_is_served_and_connections_survive(pair: Pair) -> None:
    async with secure_server(pair) as url:
        async with connect(url, ssl=pair.client(), ping_interval=None) as old:
            await old.send(HELLO.decode())
            pair.renew()
            assert await serial_now(url, pair) == serial(old)
            await asyncio.sleep(POLL_SECONDS + 1)
            assert await serial_now(url, pair) != serial(old)
            await (await old.ping())


@virtual
async def test_half_renewed_certificate_is_not_served(pair: Pair) -> None:
    async with secure_server(pair) as url:
        before = await serial_now(url, pair)
        old_cert = pair.cert.read_bytes()
        pair.renew()
        new_cert = pair.cert.read_bytes()
        replace(pair.cert, old_cert)
        await asyncio.sleep(POLL_SECONDS + 1)
        assert await serial_now(url, pair) == before
        replace(pair.cert, new_cert)
        await asyncio.sleep(POLL_SECONDS + 1)
        assert await serial_now(url, pair) != before


@pytest.mark.parametrize("fault", ["garbage", "empty", "gone", "another's key", "pipe"])
@virtual
async def test_invalid_renewal_keeps_the_old_certificate(pair: Pair, fault: str) -> None:
    async with secure_server(pair) as url:
        before = await serial_now(url, pair)
        if fault == "gone":
            pair.cert.unlink()
        elif fault == "pipe":
            pair.cert.unlink()
            os.mkfifo(pair.cert)
        elif fault == "another's key":
            pair.renew(cert=False)
        else:
            replace(pair.cert, {"garbage": b"\0\1\2", "empty": b""}[fault])
        await asyncio.sleep(POLL_SECONDS + 1)
        assert await serial_now(url, pair) == before
        pair.renew()
        await asyncio.sleep(POLL_SECONDS + 1)
        assert await serial_now(url, pair) != before


@virtual
async def test_key_that_vanishes_while_it_is_loaded_does_not_end_renewals(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    load = ssl.SSLContext.load_cert_chain

    def vanishing(context: ssl.SSLContext, *files: Any, **options: Any) -> None:
        load(context, *files, **options)
        pair.key.unlink()

    async with secure_server(pair) as url:
        before = await serial_now(url, pair)
        with monkeypatch.context() as patch:
            patch.setattr(ssl.SSLContext, "load_cert_chain", vanishing)
            pair.renew()
            await asyncio.sleep(POLL_SECONDS + 1)
        second = await serial_now(url, pair)
        pair.renew()
        await asyncio.sleep(POLL_SECONDS + 1)
        assert len({before, second, await serial_now(url, pair)}) == 3


@virtual
async def test_server_names_that_are_not_ascii_are_no_error(pair: Pair, tmp_path: Path) -> None:
    """Python prints a traceback if a callback for names is set: a stranger could fill the log."""
    name = b"kitchen.example.org"
    sent = ssl.MemoryBIO()
    client = pair.client().wrap_bio(ssl.MemoryBIO(), sent, server_hostname=name.decode())
    with pytest.raises(ssl.SSLWantReadError):
        client.do_handshake()
    hello = sent.read()
    assert name in hello
    async with serving(tmp_path / "r", tls_cert=pair.cert, tls_key=pair.key) as server:
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(hello.replace(name, b"\xff" * len(name)))
        assert (await reader.readexactly(1))[0] == HANDSHAKE
        writer.transport.abort()


@virtual
async def test_files_are_read_outside_the_event_loop(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads, load = set[threading.Thread](), ssl.SSLContext.load_cert_chain

    def observed(context: ssl.SSLContext, *files: Any, **options: Any) -> None:
        threads.add(threading.current_thread())
        load(context, *files, **options)

    async with secure_server(pair):
        monkeypatch.setattr(ssl.SSLContext, "load_cert_chain", observed)
        pair.renew()
        await asyncio.sleep(POLL_SECONDS + 1)
    assert threads
    assert threading.main_thread() not in threads


def test_old_tls_versions_are_refused(pair: Pair) -> None:
    async def scenario() -> None:
        assert ServerTLS(pair.cert, pair.key).context.minimum_version is ssl.TLSVersion.TLSv1_2
        async with secure_server(pair) as url:
            old = pair.client()
            old.minimum_version = ssl.TLSVersion.MINIMUM_SUPPORTED
            old.maximum_version = ssl.TLSVersion.TLSv1_1
            old.set_ciphers("ALL:@SECLEVEL=0")
            with pytest.raises((ssl.SSLError, ConnectionError)):
                await connect(url, ssl=old)
            recent = pair.client()
            recent.maximum_version = ssl.TLSVersion.TLSv1_2
            async with connect(url, ssl=recent) as connection:
                assert connection.transport.get_extra_info("ssl_object").version() == "TLSv1.2"

    with pytest.warns(DeprecationWarning):
        run(scenario())


def test_slow_groups_are_refused_before_they_are_computed(pair: Pair) -> None:
    """The first packet of a stranger could otherwise cost 0.2 s."""
    received, sent = ssl.MemoryBIO(), ssl.MemoryBIO()
    server = ServerTLS(pair.cert, pair.key).context.wrap_bio(received, sent, server_side=True)
    received.write(slow_hello())
    with pytest.raises(ssl.SSLError, match=r"NO_SUITABLE_KEY_SHARE|NO_SHARED_GROUP"):
        server.do_handshake()


@virtual
async def test_aborted_handshakes_leave_no_error(pair: Pair, tmp_path: Path) -> None:
    failures: list[dict[str, object]] = []
    async with serving(tmp_path, tls_cert=pair.cert, tls_key=pair.key) as server:
        asyncio.get_running_loop().set_exception_handler(lambda loop, what: failures.append(what))
        silent = [await asyncio.open_connection("127.0.0.1", server.port) for _ in range(3)]
        await asyncio.sleep(0.1)
        server.admission.newcomers.close()
        await asyncio.sleep(0.1)
        assert len(server.admission.newcomers) == 0
        for _, writer in silent:
            writer.transport.abort()
        gc.collect()
        await asyncio.sleep(0.1)
    assert not failures


@virtual
async def test_handshakes_of_displaced_connections_leave_no_tls(pair: Pair, tmp_path: Path) -> None:
    """A stranger who opens thousands of connections a second could fill the memory."""
    async with serving(tmp_path, tls_cert=pair.cert, tls_key=pair.key) as server:
        server.admission.newcomers = Newcomers(1, 100, lambda peer: "one address")
        opened = [await asyncio.open_connection("127.0.0.1", server.port) for _ in range(20)]
        await asyncio.sleep(0.1)
        for _, writer in opened:  # All arrive in the same turn of the event loop.
            writer.write(slow_hello()[:100])
        await asyncio.sleep(0.1)
        gc.collect()
        kept = [one for one in gc.get_objects() if isinstance(one, asyncio.sslproto.SSLProtocol)]
        assert len(kept) <= 1
        for _, writer in opened:
            writer.transport.abort()


@virtual
async def test_silent_connections_do_not_delay_handshakes(pair: Pair, tmp_path: Path) -> None:
    async with serving(tmp_path, tls_cert=pair.cert, tls_key=pair.key) as server:
        silent = [
            await asyncio.open_connection("127.0.0.1", server.port)
            for _ in range(HANDSHAKES_AT_ONCE)
        ]
        await asyncio.sleep(0.1)
        begun = asyncio.get_running_loop().time()
        assert await serial_now(server.url, pair)
        assert asyncio.get_running_loop().time() - begun < FAIR_SECONDS / 2
        for _, writer in silent:
            writer.transport.abort()


@virtual
async def test_clients_without_tls_are_refused(pair: Pair) -> None:
    async with secure_server(pair) as url:
        with pytest.raises(Exception, match=r"HTTP|handshake|message|reset"):
            await connect(url.replace("wss", "ws"))
        assert await serial_now(url, pair)


@virtual
async def test_client_library_explains_tls_errors(pair: Pair) -> None:
    async with secure_server(pair) as url:
        with pytest.raises(ConnectionFailedError, match=r"not trusted here .*SSL_CERT_FILE"):
            await Client(url, name="ada").__aenter__()
    async with serving(pair.cert.parent / "plain") as plain:
        with pytest.raises(ConnectionFailedError, match="does not use TLS"):
            await Client(plain.url.replace("ws", "wss"), name="ada").__aenter__()


def test_missing_files_are_reported(pair: Pair, tmp_path: Path) -> None:
    gone = tmp_path / "gone.pem"
    with pytest.raises(TLSFileError, match=r"--tls-cert .*gone\.pem: No such file"):
        ServerTLS(gone, pair.key)
    with pytest.raises(TLSFileError, match=r"--tls-key .*gone\.pem: No such file"):
        ServerTLS(pair.cert, gone)
    with pytest.raises(TLSFileError, match=r"--tls-cert .*: Is a directory"):
        ServerTLS(tmp_path, pair.key)


def test_files_of_other_kinds_are_refused(pair: Pair, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path in (pipe, Path("/dev/zero")):
        with pytest.raises(TLSFileError, match=rf"--tls-cert {path}: .*regular file"):
            ServerTLS(path, pair.key)
        with pytest.raises(TLSFileError, match=rf"--tls-key {path}: .*regular file"):
            ServerTLS(pair.cert, path)


def test_huge_file_is_refused(pair: Pair) -> None:
    with pair.key.open("ab") as file:
        file.truncate(64 * MAX_PEM_BYTES)
    tracemalloc.start()
    with pytest.raises(TLSFileError, match=r"--tls-key .*key\.pem: larger than 1048576 bytes"):
        ServerTLS(pair.cert, pair.key)
    assert tracemalloc.get_traced_memory()[1] < 8 * MAX_PEM_BYTES
    tracemalloc.stop()


def test_both_settings_are_required(pair: Pair) -> None:
    assert ServerTLS.from_settings(pair.cert, pair.key).context
    with pytest.raises(TLSFileError, match="--tls-cert is given without --tls-key"):
        ServerTLS.from_settings(pair.cert, None)
    with pytest.raises(TLSFileError, match="--tls-key is given without --tls-cert"):
        ServerTLS.from_settings(None, pair.key)


def test_swapped_files_are_reported(pair: Pair, tmp_path: Path) -> None:
    with pytest.raises(TLSFileError, match=r"--tls-cert .*key\.pem: the file has no certificate"):
        ServerTLS(pair.key, pair.cert)
    with pytest.raises(TLSFileError, match=r"--tls-key .*chain\.pem: the file has no private key"):
        ServerTLS(pair.cert, pair.cert)
    pair.renew(cert=False)
    with pytest.raises(TLSFileError, match=r"the key .*key\.pem does not belong to .*chain\.pem"):
        ServerTLS(pair.cert, pair.key)
    pair.renew()
    replace(pair.cert, pair.cert.read_bytes()[:200])
    with pytest.raises(TLSFileError, match=r"chain\.pem and .*key\.pem cannot be used: "):
        ServerTLS(pair.cert, pair.key)


def test_key_with_a_passphrase_is_refused(pair: Pair) -> None:
    key = serialization.load_pem_private_key(pair.key.read_bytes(), None)
    locked = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.BestAvailableEncryption(b"secret"),
    )
    replace(pair.key, locked)
    with pytest.raises(TLSFileError, match=r"the key has a passphrase.*openssl pkey"):
        ServerTLS(pair.cert, pair.key)


@pytest.mark.skipif(sys.platform == "win32", reason="file modes")
@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root reads everything")
def test_unreadable_key_is_reported(pair: Pair) -> None:
    pair.key.chmod(0)
    with pytest.raises(TLSFileError, match=r"--tls-key .*key\.pem: Permission denied"):
        ServerTLS(pair.cert, pair.key)


def issued(folder: Path, *names: str, common_name: str | None = None) -> ServerTLS:
    made = trustme.CA().issue_cert(*names, common_name=common_name)
    replace(folder / "key.pem", made.private_key_pem.bytes())
    replace(folder / "chain.pem", b"".join(blob.bytes() for blob in made.cert_chain_pems))
    return ServerTLS(folder / "chain.pem", folder / "key.pem")


@pytest.mark.parametrize(
    ("names", "name"),
    [
        (["kitchen.example.org"], "kitchen.example.org"),
        (["b.example.org", "a.example.org", "192.0.2.7"], "b.example.org"),
        (["*.example.org", "a.example.org"], "a.example.org"),
        (["*.example.org"], ""),
        (["192.0.2.7", "localhost"], "localhost"),
        (["192.0.2.7"], "192.0.2.7"),
        (["2001:db8::7"], "2001:db8::7"),
        ([f"{'a' * 60}.{number}.example.org" for number in range(40)], f"{'a' * 60}.0.example.org"),
        ([], ""),
    ],
)
def test_name_of_a_certificate(tmp_path: Path, names: list[str], name: str) -> None:
    assert issued(tmp_path, *names, common_name="some one").name == name


def test_renewed_certificate_changes_the_name(tmp_path: Path) -> None:
    tls = issued(tmp_path, "old.example.org")
    issued(tmp_path, "new.example.org")
    assert tls.reload()
    assert tls.name == "new.example.org"


def test_unreadable_certificate_has_no_name(pair: Pair) -> None:
    whole = certificate_names(pair.cert.read_bytes())
    assert whole == ([], ["127.0.0.1"])
    end = "-----END CERTIFICATE-----"
    der = ssl.PEM_cert_to_DER_cert(pair.cert.read_text().partition(end)[0] + end)
    for cut in range(len(der)):
        assert certificate_names(ssl.DER_cert_to_PEM_cert(der[:cut]).encode()) in (whole, ([], []))
    assert certificate_names(b"nothing") == ([], [])


async def test_public_url_has_the_certificates_name(tmp_path: Path) -> None:
    issued(tmp_path, "kitchen.example.org")
    files = {"tls_cert": tmp_path / "chain.pem", "tls_key": tmp_path / "key.pem"}
    async with serving(tmp_path, host="0.0.0.0", **files) as server:
        room = first_room(server)
        received = _greeting(server, room, "")
        assert f"at wss://kitchen.example.org:{server.port}" in received
        assert f"--url wss://kitchen.example.org:{server.port}" in received
        assert "127.0.0.1" not in received
        assert "0.0.0.0" not in received
        assert server.url == f"wss://127.0.0.1:{server.port}"


SSLPROTO = asyncio.sslproto.__file__
HELLO = b'{"type": "hello", "protocol": 1, "name": "ada", "ref": 1}'


@asynccontextmanager
async def encrypted_client(
    pair: Pair, folder: Path, version: ssl.TLSVersion
) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    """Connect to a server as a WebSocket client that has not sent hello yet."""
    context = pair.client()
    context.minimum_version = context.maximum_version = version
    async with serving(folder, tls_cert=pair.cert, tls_key=pair.key) as server:
        reader, writer = await asyncio.open_connection(
            "127.0.0.1", server.port, ssl=context, server_hostname="127.0.0.1"
        )
        writer.write(request("robotouille.v1.json"))
        await reader.readuntil(b"\r\n\r\n")
        yield reader, writer
        writer.transport.abort()


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
def test_turn_decrypts_few_of_many_small_records(
    pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, version: ssl.TLSVersion
) -> None:
    """Each byte may be in a record of its own, and each record costs the server a call."""
    sizes: list[int] = []
    take = Connection.data_received

    def counted(connection: Connection, data: bytes) -> None:
        sizes.append(len(data))
        take(connection, data)

    monkeypatch.setattr(Connection, "data_received", counted)

    async def main() -> None:
        async with encrypted_client(pair, tmp_path / "r", version) as (reader, writer):
            sizes.clear()
            for byte in frame(HELLO + b" " * 3000):
                writer.write(bytes((byte,)))
            await reader.readuntil(b'"welcome"')

    # Virtual time could pass the deadline for `hello` while so many records are in transit.
    asyncio.run(main())
    assert sum(sizes) > 3000
    assert max(sizes) <= RECORDS_AT_A_TIME


@pytest.mark.slow
@virtual
async def test_connection_holds_little_memory_for_tls(pair: Pair, tmp_path: Path) -> None:
    count = 10
    async with serving(tmp_path / "r", tls_cert=pair.cert, tls_key=pair.key) as server:
        tracemalloc.start()
        clients = [
            await asyncio.open_connection("127.0.0.1", server.port, ssl=pair.client())
            for _ in range(count)
        ]
        snapshot = tracemalloc.take_snapshot()
        tracemalloc.stop()
        for _, writer in clients:
            writer.transport.abort()
    of_tls = snapshot.filter_traces([tracemalloc.Filter(inclusive=True, filename_pattern=SSLPROTO)])
    # The clients are in the same process.
    assert sum(trace.size for trace in of_tls.traces) / (2 * count) < 32 * 1024


@virtual
async def test_records_share_the_turns_of_their_address_then_of_their_subject(
    pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    groups: list[object] = []
    wait = LoopBudget.wait

    def noted(budget: LoopBudget, resume: Callable[[], None], group: object = None) -> None:
        if isinstance(getattr(resume, "__self__", None), RecordMeter):
            groups.append(group)
        wait(budget, resume, group)

    monkeypatch.setattr(LoopBudget, "wait", noted)
    async with serving(
        tmp_path / "r", tls_cert=pair.cert, tls_key=pair.key, trust_proxy="loopback"
    ) as server:
        server.admission.turn_group_of = lambda peer: "203.0.113.7"
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port, ssl=pair.client())

        async def small_records(content: bytes) -> list[object]:
            for byte in content:
                writer.write(bytes((byte,)))
            await writer.drain()
            await asyncio.sleep(1)
            return [*dict.fromkeys(groups)]

        writer.write(request(more="X-Forwarded-For: 203.0.113.8\r\n"))
        await asyncio.sleep(1)
        assert groups
        assert {*groups} == {"203.0.113.7"}
        groups.clear()
        token = mint_token(server, Role.PLAYER)
        hello = {"type": "hello", "protocol": 1, "name": "ada", "token": token}
        assert await small_records(frame(json.dumps(hello).encode())) == ["203.0.113.8"]
        await reader.readuntil(b'"welcome"')
        groups.clear()
        assert await small_records(frame(b'{"type": "resync"}' + b" " * 300)) == ["subject p-1"]
        writer.transport.abort()


def test_messages_in_large_records_arrive_whole(pair: Pair, tmp_path: Path) -> None:
    async def main() -> None:
        async with encrypted_client(pair, tmp_path / "r", ssl.TLSVersion.TLSv1_3) as (
            reader,
            writer,
        ):
            writer.write(frame(HELLO))
            await reader.readuntil(b'"welcome"')
            # The answers to both come after the server has read all of the first.
            writer.write(frame(b'{"type":"list","ref":2,"x":"' + b"x" * 60_000 + b'"}'))
            writer.write(frame(b'{"type":"list","ref":3}'))
            await reader.readuntil(b'"ref":3')

    asyncio.run(main())
