"""Paths of the operator port: the HTTP API and the files of the page."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from http import HTTPStatus
from importlib.resources import files
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, FastAPI, Query, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response, StreamingResponse
from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.routing import Route

from robotouille.replay.annotations import Codebook
from robotouille.web.single_file import filled
from robotouille.web.site import STATIC, bundled_module, shared_site
from robotouille_server.operator.event_streams import EventStreams
from robotouille_server.operator.forwarding import NodeRequest
from robotouille_server.operator.guard import POLICY, SAFE
from robotouille_server.operator.load import ROWS_A_TURN, RequestRates, unless_gone
from robotouille_server.operator.models import (
    AnnounceRequest,
    Done,
    EndRequest,
    EpisodeDetail,
    KickRequest,
    KitchenTables,
    MuteRequest,
    NoRequest,
    OpenedEpisodes,
    OpenRequest,
    Overview,
    PictureData,
    Problem,
    RecordingPage,
    SpectatorLink,
    TaskList,
)
from robotouille_server.operator.other_nodes import EpisodeElsewhereError, OtherNodes, OverviewQuery
from robotouille_server.operator.principal import Principal, RequestRefusedError
from robotouille_server.operator.service import OperatorService
from robotouille_server.runtime.logs import get_logger

TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
REPLAY_HEAD = """<link rel="icon" href="icon.svg" type="image/svg+xml">
    <link rel="stylesheet" href="replay/page.css">
    <link rel="stylesheet" href="replay/replay.css">"""
REPLAY_END = """<script type="module" src="show_replay.js"></script>"""
REPLAY_POLICY = POLICY.replace("img-src 'self' data:", "img-src 'self' data: blob:")


def page_routes() -> list[Route]:
    """Return a route for each file of the page. The path `/` is `index.html`."""
    routes = []
    for file in files(__package__).joinpath("page").iterdir():
        suffix = f".{file.name.rpartition('.')[2]}"
        if suffix in TYPES:
            path = "/" if file.name == "index.html" else f"/{file.name}"
            routes.append(_route(path, file.read_bytes(), TYPES[suffix]))
    return [*routes, *_replay_routes(), *_live_routes()]


def _replay_routes() -> Iterator[Route]:
    """Yield routes for the page that shows a recording, whose name is after the `#`."""
    page = (STATIC / "replay/index.html").read_text(encoding="utf-8")
    html = filled(page, head=REPLAY_HEAD, end=REPLAY_END).encode()
    # The replay shows pictures from the data of a recording.
    yield _route("/replay", html, TYPES[".html"], policy=REPLAY_POLICY)
    for name in ("page.css", "replay/replay.css"):
        path = f"/replay/{name.rpartition('/')[2]}"
        yield _route(path, (STATIC / name).read_bytes(), TYPES[".css"])
    yield _route("/replay/bundle.js", bundled_module("replay/main.js"), TYPES[".js"])


def _live_routes() -> Iterator[Route]:
    """Yield routes for the picture of a running kitchen, and the looks of shipped ones."""
    yield _route("/replay/live.js", bundled_module("replay/live.js"), TYPES[".js"])
    site = shared_site()
    for name in site.names:
        if name.endswith(".json") and (file := site.find(name)) is not None:
            yield _route(f"/{name}", file.content, file.kind)


def page_paths() -> frozenset[str]:
    """Return the paths of the page's files."""
    return frozenset(route.path for route in page_routes())


def _route(path: str, content: bytes, kind: str, policy: str = POLICY) -> Route:
    headers = {
        "content-type": kind,
        "cache-control": "no-cache",
        "content-security-policy": policy,
    }

    async def serve(request: Request) -> Response:
        return Response(content, headers=headers)

    return Route(path, serve, methods=["GET"])


API_VERSION = "1"
DESCRIPTION = (
    "Requests need a token if they come to an address that is not loopback, if they come through a "
    "proxy, or if the server runs with `--require-token`. Every error is a `Problem`."
)
CHANGE = {
    "name": "X-Robotouille-Operator",
    "in": "header",
    "required": True,
    "schema": {"type": "string"},
    "description": "Any value, e.g. `1`. Pages of other sites cannot send this header.",
}
OVERVIEW_SECONDS = 1.0

router = APIRouter(
    prefix="/api",
    responses={"default": {"model": Problem}},
    generate_unique_id_function=lambda route: route.name,
)


async def _principal(request: Request) -> Principal:
    principal: Principal = request.state.principal
    return principal


async def _service(request: Request) -> OperatorService:
    service: OperatorService = request.app.state.service
    return service.for_principal(request.state.principal)


async def _streams(request: Request) -> EventStreams:
    streams: EventStreams = request.app.state.streams
    return streams


async def _rates(request: Request) -> RequestRates:
    rates: RequestRates = request.app.state.rates
    return rates


ThePrincipal = Annotated[Principal, Depends(_principal)]
TheService = Annotated[OperatorService, Depends(_service)]
TheStreams = Annotated[EventStreams, Depends(_streams)]
TheRates = Annotated[RequestRates, Depends(_rates)]
AnyPhase = Literal["", "waiting", "running", "paused", "ended"]
PhaseParameter = Annotated[AnyPhase, Query(description="Only episodes in this phase.")]
Search = Annotated[
    str, Query(max_length=100, description="Words that all occur in code, task, names or labels.")
]
SearchOfRecordings = Annotated[
    str,
    Query(
        max_length=100,
        description="Words that all occur in file name, code, task, names or labels. Of the 2,000 "
        "newest recordings, all are searched, of older ones the file names.",
    ),
]
Limit = Annotated[int, Query(ge=1, le=200, description="Maximum number of rows.")]
Offset = Annotated[int, Query(ge=0, description="Number of rows to skip.")]
EVENTS: dict[int | str, dict[str, Any]] = {
    200: {"description": "Server-sent events.", "content": {"text/event-stream": {}}}
}
FILE: dict[int | str, dict[str, Any]] = {
    200: {"description": "The file.", "content": {"application/octet-stream": {}}}
}


@router.get("/overview", summary="Return totals, warnings and episodes", response_model=Overview)
async def overview(
    service: TheService,
    principal: ThePrincipal,
    rates: TheRates,
    phase: PhaseParameter = "",
    search: Search = "",
    limit: Limit = 50,
    offset: Offset = 0,
) -> Response:
    rates.charge(principal.token_subject, limit // ROWS_A_TURN)
    return _json(await service.overview(OverviewQuery(phase, search, limit, offset)))


@router.get("/node", include_in_schema=False)
async def node(
    service: TheService,
    principal: ThePrincipal,
    rates: TheRates,
    phase: PhaseParameter = "",
    search: Search = "",
    limit: Annotated[int, Query(ge=0, le=200)] = 0,
    offset: Offset = 0,
) -> Response:
    # Other nodes of a cluster ask for this. They have charged the operator already.
    if not principal.via:
        rates.charge(principal.token_subject, limit // ROWS_A_TURN)
    return _json(await service.part(OverviewQuery(phase, search, limit, offset)))


@router.get(
    "/overview/events",
    summary="Stream the overview once per second",
    response_class=Response,
    responses=EVENTS,
)
async def overview_events(
    service: TheService,
    streams: TheStreams,
    principal: ThePrincipal,
    phase: PhaseParameter = "",
    search: Search = "",
    limit: Limit = 50,
    offset: Offset = 0,
) -> Response:
    async def read() -> BaseModel:
        return await service.overview(OverviewQuery(phase, search, limit, offset))

    return _events(streams.events(read, OVERVIEW_SECONDS, principal))


@router.get("/tasks", summary="List the tasks of episodes that the server can open")
async def tasks(service: TheService) -> TaskList:
    return await service.tasks()


@router.post("/episodes", summary="Open episodes with the same options")
async def open_episodes(
    service: TheService, principal: ThePrincipal, rates: TheRates, request: OpenRequest
) -> OpenedEpisodes:
    rates.charge(principal.token_subject, request.count)
    return await service.open(request)


@router.get("/episodes/{episode}", summary="Return one episode: state, recent events, spectators")
async def episode(service: TheService, episode: str) -> EpisodeDetail:
    return await service.watch(episode).detail()


@router.get(
    "/episodes/{episode}/events",
    summary="Stream one episode when it changes",
    response_class=Response,
    responses=EVENTS,
)
async def episode_events(
    service: TheService, streams: TheStreams, principal: ThePrincipal, episode: str
) -> Response:
    read, seconds = service.watch_anywhere(episode)
    return _events(streams.events(read, seconds, principal))


@router.get("/episodes/{episode}/kitchen", summary="Return what is needed to draw an episode")
async def kitchen(service: TheService, episode: str) -> KitchenTables:
    return service.kitchen(episode)


@router.get("/episodes/{episode}/pictures/{digest}", summary="Return a picture of a task's own")
async def picture(service: TheService, episode: str, digest: str) -> PictureData:
    return service.picture(episode, digest)


@router.post("/episodes/{episode}/pause", summary="Pause an episode")
async def pause(service: TheService, episode: str, request: NoRequest) -> Done:
    return service.pause(episode)


@router.post("/episodes/{episode}/resume", summary="Resume an episode")
async def resume(service: TheService, episode: str, request: NoRequest) -> Done:
    return service.resume(episode)


@router.post("/episodes/{episode}/end", summary="End an episode")
async def end(service: TheService, episode: str, request: EndRequest) -> Done:
    return service.end(episode, request.reason)


@router.post("/episodes/{episode}/kick", summary="Remove a player or spectator")
async def kick(service: TheService, episode: str, request: KickRequest) -> Done:
    return service.kick(episode, request.session, request.reason)


@router.post("/episodes/{episode}/mute", summary="Forbid or allow a participant to chat")
async def mute(service: TheService, episode: str, request: MuteRequest) -> Done:
    return service.mute(episode, request.session, muted=request.muted)


@router.post("/episodes/{episode}/announce", summary="Send an announcement to an episode")
async def announce(service: TheService, episode: str, request: AnnounceRequest) -> Done:
    return service.announce(episode, request.text)


@router.post("/episodes/{episode}/spectator_link", summary="Make a link for a spectator")
async def spectator_link(service: TheService, episode: str, request: NoRequest) -> SpectatorLink:
    return service.spectator_link(episode)


@router.post("/announce", summary="Send an announcement to all episodes")
async def announce_to_all(service: TheService, request: AnnounceRequest) -> Done:
    return await service.announce_to_all(request.text)


@router.get("/recordings", summary="List recordings, newest first", response_model=RecordingPage)
async def recordings(
    service: TheService, search: SearchOfRecordings = "", limit: Limit = 50, offset: Offset = 0
) -> Response:
    return _json(await service.recordings.page(search, limit, offset))


@router.get(
    "/recordings/{name}",
    summary="Download a recording",
    response_class=Response,
    responses=FILE,
)
async def recording(service: TheService, name: str) -> Response:
    size, content = await service.recordings.content(name)
    headers = {
        "content-disposition": f'attachment; filename="{name}"',
        "content-length": str(size),
    }
    return StreamingResponse(content, media_type="application/octet-stream", headers=headers)


@router.get(
    "/recordings/{name}/replay",
    summary="Return the data of the page that shows a recording, as compressed JSON",
    response_class=Response,
    responses=FILE,
)
async def replay(request: Request, service: TheService, name: str) -> Response:
    data = await unless_gone(request, service.recordings.replay(name))
    return Response(data, media_type="application/gzip")


@router.post("/codebook", summary="Check a codebook for labels in a replay")
async def codebook(request: Codebook) -> Codebook:
    return request


@router.get(
    "/archive",
    summary="Download several recordings as one tar file",
    response_class=Response,
    responses=FILE,
)
async def archive(
    service: TheService,
    principal: ThePrincipal,
    rates: TheRates,
    name: Annotated[list[str], Query(max_length=100, description="Recordings; all without.")] = [],  # noqa: B006
    search: SearchOfRecordings = "",
) -> Response:
    names = await service.recordings.archived(name, search)
    rates.charge(principal.token_subject, len(names) // ROWS_A_TURN)
    headers = {"content-disposition": 'attachment; filename="recordings.tar"'}
    return StreamingResponse(
        service.recordings.archive(names), media_type="application/x-tar", headers=headers
    )


def _json(value: BaseModel) -> Response:
    # FastAPI would check the value again and encode it in Python, which takes far longer.
    return Response(value.model_dump_json(), media_type="application/json")


def _events(events: AsyncIterator[str]) -> StreamingResponse:
    return StreamingResponse(
        events,
        media_type="text/event-stream",
        headers={"x-accel-buffering": "no"},  # nginx would otherwise hold events back.
    )


async def _refused(request: Request, error: Exception) -> Response:
    if not isinstance(error, RequestRefusedError):
        raise error
    service: OperatorService = request.app.state.service.for_principal(request.state.principal)
    if isinstance(error, EpisodeElsewhereError) and service.others is not None:
        try:
            return await _forwarded(request, error, service.others)
        except RequestRefusedError as refused:
            error = refused
    # A failed read is no event for the audit log, except by a token for another episode.
    if request.method not in SAFE or error.status is HTTPStatus.FORBIDDEN:
        what = request.scope["route"].name.replace("_", " ")
        service.refused(what, request.path_params.get("episode", ""), error.code)
    refusal = _problem(error.status, error.code, error.message, error.field)
    if error.retry_seconds is not None:
        refusal.headers["retry-after"] = str(error.retry_seconds)
    return refusal


async def _forwarded(
    request: Request, elsewhere: EpisodeElsewhereError, others: OtherNodes
) -> Response:
    """Return the answer of the node that has the episode of a request."""
    asked = NodeRequest(
        "GET" if request.method in SAFE else "POST",
        request.url.path,
        request.url.query,
        await request.body(),
    )
    answer = await others.ask(elsewhere.node, request.state.principal, asked)
    return Response(answer.body, answer.status, dict(answer.headers))


async def _invalid(request: Request, error: Exception) -> Response:
    if not isinstance(error, RequestValidationError):
        raise error
    fault = error.errors()[0]
    where = ".".join(str(part) for part in fault["loc"][1:])
    message = f"invalid {where or 'body'}: {fault['msg']}"
    return _problem(HTTPStatus.BAD_REQUEST, "request/invalid", message, where)


async def _no_such_path(request: Request, error: Exception) -> Response:
    if not isinstance(error, HTTPException):
        raise error
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        message = f"{request.url.path} does not support {request.method}"
        return _problem(HTTPStatus.METHOD_NOT_ALLOWED, "request/method", message)
    if error.status_code == HTTPStatus.BAD_REQUEST:
        # FastAPI's error for a body that Python cannot read at all, such as too deep JSON.
        return _problem(HTTPStatus.BAD_REQUEST, "request/invalid", "the body cannot be read")
    message = f"unknown path {request.url.path}"
    return _problem(HTTPStatus.NOT_FOUND, "request/unknown", message)


async def _failed(request: Request, error: Exception) -> Response:
    get_logger().error("operator page failed", path=request.url.path, exc_info=error)
    message = "internal error; see the server's log"
    return _problem(HTTPStatus.INTERNAL_SERVER_ERROR, "operator/internal", message)


def _problem(status: HTTPStatus, code: str, message: str, field: str = "") -> Response:
    problem = Problem(code=code, message=message, field=field)
    return JSONResponse(problem.model_dump(exclude_defaults=True), status)


class OperatorApi(FastAPI):
    """Application whose OpenAPI document includes the requirements of the guard."""

    def openapi(self) -> dict[str, Any]:
        described = super().openapi()
        described["components"]["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
        described["security"] = [{}, {"token": []}]
        for methods in described["paths"].values():
            if "post" in methods:
                methods["post"].setdefault("parameters", [])
                if CHANGE not in methods["post"]["parameters"]:
                    methods["post"]["parameters"].append(CHANGE)
        return described


def application(
    service: OperatorService | None,
    streams: EventStreams | None,
    rates: RequestRates | None,
) -> FastAPI:
    """Return the ASGI application. Without a service it can only describe itself."""
    app = OperatorApi(
        title="Robotouille operator API",
        version=API_VERSION,
        summary="Watch and control the episodes of a server, or of a cluster.",
        description=DESCRIPTION,
        docs_url=None,
        redoc_url=None,
        openapi_url="/api/openapi.json",
    )
    app.state.service = service
    app.state.streams = streams
    app.state.rates = rates
    # Routes of `include_router` are made again by each application, with all their schemas.
    app.router.routes.extend([*router.routes, *page_routes()])
    app.add_exception_handler(RequestRefusedError, _refused)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(HTTPException, _no_such_path)
    app.add_exception_handler(Exception, _failed)
    return app


def document() -> dict[str, Any]:
    """Return the OpenAPI document."""
    return application(None, None, None).openapi()
