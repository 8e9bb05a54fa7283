"""The other nodes of a cluster, as an operator of this node sees and controls them."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from urllib.parse import quote, urlencode

from pydantic import ValidationError

from robotouille.replay.file_names import recording_stem
from robotouille_server.app import Server
from robotouille_server.cluster.bus import BusError
from robotouille_server.cluster.members import NodeReport
from robotouille_server.cluster.node import ClusterNode
from robotouille_server.cluster.service import ClusterService
from robotouille_server.operator.forwarding import (
    ANSWER_SECONDS,
    NodeAnswer,
    NodeRequest,
    decode_answer,
    encode_request,
    unreadable,
)
from robotouille_server.operator.merging import merged, on_node, parts_of_page
from robotouille_server.operator.models import (
    Done,
    EpisodeDetail,
    NodeOverview,
    NodeRow,
    Overview,
    RecordingPage,
    RecordingRow,
)
from robotouille_server.operator.principal import Principal, RequestRefusedError

OVERVIEW_SECONDS = 0.5
"""Seconds after which each of two questions to all nodes is complete without the silent ones."""
MAX_UNDER_WAY = 128
"""Requests to other nodes at a time."""
MAX_ROWS = 200
"""Rows of a page of recordings."""
BUSY_SECONDS = 1
NODE_PATH = "/api/node"
"""Path at which a node answers with its own part of the overview."""


class EpisodeElsewhereError(RequestRefusedError):
    """Another node has the episode. Requests are forwarded to it instead of being refused."""

    def __init__(self, node: NodeReport, name: str) -> None:
        self.node = node
        message = f"{name} runs on the node {node.url}"
        super().__init__(HTTPStatus.MISDIRECTED_REQUEST, "node/unavailable", message)


@dataclass(frozen=True, slots=True)
class OverviewQuery:
    """Selection of episodes for an overview."""

    phase: str = ""
    search: str = ""
    limit: int = 50
    offset: int = 0

    def part(self, offset: int, limit: int) -> OverviewQuery:
        """Return the query for another part of the list."""
        return OverviewQuery(self.phase, self.search, limit, offset)

    @property
    def encoded(self) -> str:
        """Query of a URL."""
        fields = {"phase": self.phase, "search": self.search}
        return urlencode({**fields, "limit": self.limit, "offset": self.offset})


Overviews = Callable[[OverviewQuery], Awaitable[NodeOverview]]
"""Returns a node's part of an overview."""


def cluster_node(server: Server) -> ClusterNode | None:
    """Return the node of a cluster that a server is, if it is one."""
    cluster = server.services.cluster
    return cluster.node if isinstance(cluster, ClusterService) else None


class OtherNodes:
    """Requests to the other nodes' operator APIs."""

    def __init__(self, node: ClusterNode) -> None:
        self._node = node
        self._loop = asyncio.get_running_loop()
        self._under_way = 0

    @property
    def own(self) -> NodeReport:
        """Report of this node."""
        return self._node.members.own

    # Where an episode is

    def place(self, name: str) -> NodeReport | None:
        """Return the other node that has an episode, by id or code."""
        record = self._node.directory.find(name)
        if record is None or record.node == self._node.name:
            return None
        return self._node.members.find(record.node)

    def names(self, name: str) -> tuple[str, ...]:
        """Return the id and the code of an episode of any node."""
        record = self._node.directory.find(name)
        return (name,) if record is None else (record.episode, record.code)

    def place_of_recording(self, name: str) -> NodeReport | None:
        """Return the other node that has the episode with a recording."""
        return self.place(recording_stem(name).rpartition("_")[2])

    # Requests

    async def ask(
        self,
        node: NodeReport,
        principal: Principal,
        request: NodeRequest,
        seconds: float = ANSWER_SECONDS,
    ) -> NodeAnswer:
        """Return the answer of another node's operator API to a request of an operator.

        Raises:
            RequestRefusedError: It could not be asked, or its answer cannot be read.
        """
        data = encode_request(self._node.name, principal, request)
        if self._under_way >= MAX_UNDER_WAY:
            message = f"{self._under_way} requests to other nodes are under way; try again"
            status = HTTPStatus.SERVICE_UNAVAILABLE
            raise RequestRefusedError(status, "operator/busy", message, BUSY_SECONDS)
        self._under_way += 1
        try:
            subject = f"operator.{node.name}.request"
            return decode_answer(await self._node.bus.request(subject, data, seconds))
        except BusError:
            message = f"{node.url} does not answer, or has no operator page"
            status = HTTPStatus.GATEWAY_TIMEOUT
            raise RequestRefusedError(status, "node/unavailable", message) from None
        except ValueError:
            raise unreadable() from None
        finally:
            self._under_way -= 1

    async def change(
        self, node: NodeReport, principal: Principal, path: str, body: Mapping[str, object]
    ) -> Done:
        """Change something on another node; raise RequestRefusedError if that is not possible."""
        request = NodeRequest("POST", path, body=json.dumps(body).encode())
        answer = await self.ask(node, principal, request)
        try:
            return Done.model_validate_json(answer.checked())
        except ValidationError:
            raise unreadable() from None

    async def detail(self, node: NodeReport, principal: Principal, episode: str) -> EpisodeDetail:
        """Return an episode of another node; raise RequestRefusedError if that is not possible."""
        request = NodeRequest("GET", f"/api/episodes/{quote(episode, safe='')}")
        answer = await self.ask(node, principal, request)
        try:
            return EpisodeDetail.model_validate_json(answer.checked())
        except ValidationError:
            raise unreadable() from None

    async def announce(self, principal: Principal, text: str) -> list[str]:
        """Announce a text on all other nodes; return the addresses of those that have failed."""
        others = self._node.members.alive()[1:]
        body = {"text": text}
        done = await asyncio.gather(
            *(self.change(node, principal, "/api/announce", body) for node in others),
            return_exceptions=True,
        )
        return [
            node.url for node, one in zip(others, done, strict=True) if not isinstance(one, Done)
        ]

    # Recordings

    async def recordings(
        self, principal: Principal, search: str, count: int
    ) -> list[tuple[NodeReport, RecordingPage]]:
        """Return the newest recordings of all other nodes that answer."""
        nodes = self._node.members.alive()[1:]
        pages = await asyncio.gather(
            *(self._recordings_of(node, principal, search, count) for node in nodes),
            return_exceptions=True,
        )
        return [
            (node, page)
            for node, page in zip(nodes, pages, strict=True)
            if isinstance(page, RecordingPage)
        ]

    async def _recordings_of(
        self, node: NodeReport, principal: Principal, search: str, count: int
    ) -> RecordingPage:
        found, rows = 1, list[RecordingRow]()
        while len(rows) < min(count, found):
            limit = min(count - len(rows), MAX_ROWS)
            query = urlencode({"search": search, "limit": limit, "offset": len(rows)})
            request = NodeRequest("GET", "/api/recordings", query)
            answer = await self.ask(node, principal, request)
            try:
                page = RecordingPage.model_validate_json(answer.checked())
            except ValidationError:
                raise unreadable() from None
            found = page.found if page.recordings else 0
            rows += [row.model_copy(update={"node": node.url}) for row in page.recordings]
        return RecordingPage(found=max(found, len(rows)), recordings=rows)

    async def node_with_recording(self, principal: Principal, name: str) -> NodeReport | None:
        """Return the other node that has a recording."""
        if (node := self.place_of_recording(name)) is not None:
            return node
        for other, page in await self.recordings(principal, name, 1):
            if any(row.name == name for row in page.recordings):
                return other
        return None

    async def recording(self, node: NodeReport, principal: Principal, name: str) -> bytes:
        """Return a recording of another node; raise RequestRefusedError if that is not possible."""
        request = NodeRequest("GET", f"/api/recordings/{quote(name, safe='')}")
        return (await self.ask(node, principal, request)).checked()

    # Overview

    async def overview(
        self, own: Overviews, principal: Principal, query: OverviewQuery
    ) -> Overview:
        """Return the overview of all nodes that answer.

        Args:
            own: Returns this node's part of the overview.
            principal: The operator.
            query: Which episodes to show.
        """
        others = sorted(self._node.members.alive()[1:], key=lambda node: (node.url, node.name))
        problems: dict[str, str] = {}
        # Only the numbers of episodes tell which rows are on the page.
        nothing = query.part(0, 0)
        counts = await own(nothing)
        found = await self._parts(principal, dict.fromkeys(others, nothing), problems)
        ranks = [counts.ranks, *(part.ranks for part in found.values())]
        first, *places = parts_of_page(ranks, query.offset, query.limit)
        wanted = {
            node: query.part(*place) for node, place in zip(found, places, strict=True) if place[1]
        }
        pages = await self._parts(principal, wanted, problems)
        ours = await own(query.part(*first))
        rows = [
            *ours.episodes,
            *(row for page in pages.values() for row in page.episodes),
        ]
        return merged(counts, list(found.values()), rows, self._rows(problems))

    async def _parts(
        self,
        principal: Principal,
        queries: Mapping[NodeReport, OverviewQuery],
        problems: dict[str, str],
    ) -> dict[NodeReport, NodeOverview]:
        """Return nodes' parts of the overview, and note why some are missing."""
        answers = await asyncio.gather(
            *(self._part(node, principal, query) for node, query in queries.items()),
            return_exceptions=True,
        )
        found = {}
        for node, answer in zip(queries, answers, strict=True):
            if isinstance(answer, NodeOverview):
                found[node] = answer
            elif isinstance(answer, RequestRefusedError):
                problems[node.name] = answer.message
            else:
                raise answer
        return found

    async def _part(
        self, node: NodeReport, principal: Principal, query: OverviewQuery
    ) -> NodeOverview:
        request = NodeRequest("GET", NODE_PATH, query.encoded)
        answer = await self.ask(node, principal, request, OVERVIEW_SECONDS)
        try:
            found = NodeOverview.model_validate_json(answer.checked())
        except ValidationError:
            raise unreadable() from None
        return on_node(found, node.url, query.limit)

    def _rows(self, problems: Mapping[str, str]) -> list[NodeRow]:
        members = self._node.members
        own = members.own
        return [
            NodeRow(
                node=report.url,
                operator=report.operator,
                seats=report.load,
                silent=round(silent, 1),
                leaving=report.leaving,
                version=report.release,
                same_version=(report.release, report.protocol) == (own.release, own.protocol),
                same_keys=report.keys == own.keys,
                same_tasks=report.tasks == own.tasks,
                problem=problems.get(report.name) or self._problem(report),
            )
            for report, silent in members.heard_of(self._loop.time())
        ]

    def _problem(self, report: NodeReport) -> str:
        alive = self._node.members.find(report.name) is not None
        return "" if alive else "it is silent; other nodes take its episodes over"
