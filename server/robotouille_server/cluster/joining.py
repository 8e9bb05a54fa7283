"""Start of a server as a node of a cluster."""

from __future__ import annotations

import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from urllib.parse import urlsplit

from robotouille.errors import RobotouilleError
from robotouille.installation import RELEASE
from robotouille.nats.address import nats_address
from robotouille_server.app import Server
from robotouille_server.auth import key_file, revoked_file
from robotouille_server.auth.keys import Keyring
from robotouille_server.cluster.bus import Bus, BusError, until_available
from robotouille_server.cluster.keys.secrets import SharedSecrets, keys_digest, read_cluster_key
from robotouille_server.cluster.members import NodeReport
from robotouille_server.cluster.nats.nats_bus import nats_bus
from robotouille_server.cluster.node import ClusterNode, NodeParts
from robotouille_server.cluster.service import ClusterService
from robotouille_server.rooms.recording.storage import Folder
from robotouille_server.rooms.room_factory import Surroundings
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.metrics import ClusterMetrics
from robotouille_server.runtime.settings import ServerSettings


@dataclass(frozen=True, slots=True)
class Cluster:
    """A cluster that this process has joined, before its server starts.

    Attributes:
        around: The surroundings with which the server must be started.
        node: This node.
    """

    around: Surroundings
    node: ClusterNode
    metrics: ClusterMetrics
    secrets: SharedSecrets

    @asynccontextmanager
    async def serving(self, server: Server) -> AsyncIterator[ClusterService]:
        """Let a server that listens take part for the time of an `async with` block."""
        service = ClusterService(self.node, server.services, self.secrets)
        server.metrics.cluster = self.metrics
        server.settle, server.ready = self.node.settled, lambda: self.node.ready
        try:
            # The others ask this node as soon as they have its first report.
            await service.start()
            await self.node.serve(server.lobby, _url(server))
        except BusError as error:
            raise RobotouilleError(f"--cluster: {error}") from None
        server.services.cluster = service
        get_logger().info("joined the cluster", node=self.node.name, others=len(service.nodes))
        try:
            yield service
        finally:
            await service.stop()


@asynccontextmanager
async def joined(settings: ServerSettings) -> AsyncIterator[Cluster]:
    """Connect to NATS and join the cluster of the settings.

    Raises:
        RobotouilleError: A setting is invalid, NATS cannot be used, or the other nodes have other
            keys.
    """
    if settings.workers > 1:
        text = "--cluster needs --workers 1; start one server for each core instead"
        raise RobotouilleError(text)
    if not settings.record:
        raise RobotouilleError("--cluster needs recordings: other nodes continue from them")
    address = nats_address(
        settings.cluster,
        settings.cluster_name,
        password_file=settings.cluster_password_file,
        ca=settings.cluster_ca,
        credentials=settings.cluster_credentials,
    )
    async with nats_bus(address) as bus, joined_through(bus, settings) as cluster:
        yield cluster


@asynccontextmanager
async def joined_through(
    bus: Bus, settings: ServerSettings, around: Surroundings | None = None
) -> AsyncIterator[Cluster]:
    """Join the cluster that a bus connects."""
    around = around or Surroundings()
    given = settings.signing_keys is not None
    shared = SharedSecrets(
        bus,
        None if given else key_file(settings),
        revoked_file(settings),
        read_cluster_key(settings.cluster_key) if settings.cluster_key is not None else None,
        around.wall,
    )
    metrics = ClusterMetrics()
    storage = around.storage or Folder(settings.recordings)
    digest = shared.digest
    if settings.signing_keys is not None:
        ring = Keyring.parse(settings.signing_keys.get_secret_value())
        digest = partial(keys_digest, ring.keys)
    parts = NodeParts(
        storage,
        metrics,
        around.wall,
        settings.recovery_seconds,
        every_second=shared.share_changes,
        restore=shared.restore,
        keys=digest,
    )
    name = f"{around.randomness.getrandbits(64):016x}"
    try:
        await until_available(shared.join)
        report = NodeReport(name=name, url="", release=RELEASE, keys=digest())
        node = ClusterNode(bus, report, parts)
        await until_available(node.join)
    except BusError as error:
        raise RobotouilleError(f"--cluster: {error}") from None
    try:
        around = Surroundings(
            randomness=around.randomness,
            timestamp=around.timestamp,
            storage=storage,
            wall=around.wall,
            worker=node.slot,
            bot_worker=around.bot_worker,
            cluster=node,
        )
        yield Cluster(around, node, metrics, shared)
    finally:
        await node.close()


def _url(server: Server) -> str:
    """Return the address at which clients reach a server."""
    settings = server.settings
    if settings.cluster_url:
        parts = urlsplit(settings.cluster_url)
        if parts.scheme not in ("ws", "wss") or not parts.hostname:
            raise RobotouilleError(
                f"--cluster-url: {settings.cluster_url!r} is not ws://HOST or wss://HOST"
            )
        return settings.cluster_url
    everywhere = settings.host in ("0.0.0.0", "::")  # noqa: S104
    if everywhere and server.public_url == server.url:
        return f"{urlsplit(server.url).scheme}://{socket.gethostname()}:{server.port}"
    return server.public_url
