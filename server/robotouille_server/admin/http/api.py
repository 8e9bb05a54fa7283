"""The operator's HTTP API: paths and what they answer."""

from __future__ import annotations

from collections.abc import AsyncIterator
from http import HTTPStatus
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, FastAPI, Query, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response, StreamingResponse
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from robotouille_server.admin.admin_service import AdminService
from robotouille_server.admin.errors import RequestRefusedError
from robotouille_server.admin.http.assets import page_routes
from robotouille_server.admin.http.event_streams import Streams
from robotouille_server.admin.http.guard import SAFE
from robotouille_server.admin.models import (
    AnnounceRequest,
    Done,
    EndRequest,
    EpisodeDetail,
    KickRequest,
    MuteRequest,
    NoRequest,
    Overview,
    Problem,
    RecordingPage,
)
from robotouille_server.admin.principal import Principal
from robotouille_server.runtime.logs import get_logger

__all__ = ["application", "document"]

API_VERSION = "1"
DESCRIPTION = (
    "A token is needed where the server asks for one: on every address that is not loopback, with "
    "`--require-token`, and behind a proxy. Every error is a `Problem`."
)
CHANGE = {
    "name": "X-Robotouille-Operator",
    "in": "header",
    "required": True,
    "schema": {"type": "string"},
    "description": "Any value, e.g. `1`: what pages of other sites cannot send.",
}
OVERVIEW_SECONDS = 1.0
WATCH_SECONDS = 0.25

router = APIRouter(prefix="/api", responses={"default": {"model": Problem}})


async def _principal(request: Request) -> Principal:
    principal: Principal = request.state.principal
    return principal


async def _service(request: Request) -> AdminService:
    """The service as the principal may use it."""
    service: AdminService = request.app.state.service
    return service.serving(request.state.principal)


async def _streams(request: Request) -> Streams:
    streams: Streams = request.app.state.streams
    return streams


ThePrincipal = Annotated[Principal, Depends(_principal)]
TheService = Annotated[AdminService, Depends(_service)]
TheStreams = Annotated[Streams, Depends(_streams)]
AnyPhase = Literal["", "waiting", "running", "paused", "over"]
PhaseParameter = Annotated[AnyPhase, Query(description="Only episodes in this phase.")]
Search = Annotated[
    str, Query(max_length=100, description="Words that all occur in the code, task or names.")
]
Limit = Annotated[int, Query(ge=1, le=200, description="How many to show.")]
Offset = Annotated[int, Query(ge=0, description="How many to pass over.")]
EVENTS: dict[int | str, dict[str, Any]] = {
    200: {"description": "Server-sent events.", "content": {"text/event-stream": {}}}
}
FILE: dict[int | str, dict[str, Any]] = {
    200: {"description": "The file.", "content": {"application/octet-stream": {}}}
}


@router.get("/overview", summary="The server, its totals and its episodes")
async def overview(
    service: TheService,
    phase: PhaseParameter = "",
    search: Search = "",
    limit: Limit = 50,
    offset: Offset = 0,
) -> Overview:
    return service.overview(phase, search, limit, offset)


@router.get(
    "/overview/events",
    summary="The overview once a second",
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
    async def look() -> BaseModel:
        return service.overview(phase, search, limit, offset)

    return _events(streams.events(look, OVERVIEW_SECONDS, principal))


@router.get("/episodes/{episode}", summary="One episode: its state in words, what happened last")
async def episode(service: TheService, episode: str) -> EpisodeDetail:
    return await service.watch(episode).look()


@router.get(
    "/episodes/{episode}/events",
    summary="One episode, four times a second while something changes",
    response_class=Response,
    responses=EVENTS,
)
async def episode_events(
    service: TheService, streams: TheStreams, principal: ThePrincipal, episode: str
) -> Response:
    return _events(streams.events(service.watch(episode).look, WATCH_SECONDS, principal))


@router.post("/episodes/{episode}/pause", summary="Let an episode stand still")
async def pause(service: TheService, episode: str, request: NoRequest) -> Done:
    return service.pause(episode)


@router.post("/episodes/{episode}/resume", summary="Let it go on")
async def resume(service: TheService, episode: str, request: NoRequest) -> Done:
    return service.resume(episode)


@router.post("/episodes/{episode}/end", summary="End an episode")
async def end(service: TheService, episode: str, request: EndRequest) -> Done:
    return service.end(episode, request.reason)


@router.post("/episodes/{episode}/kick", summary="Remove a player or a spectator")
async def kick(service: TheService, episode: str, request: KickRequest) -> Done:
    return service.kick(episode, request.session, request.reason)


@router.post("/episodes/{episode}/mute", summary="Let somebody talk no more, or again")
async def mute(service: TheService, episode: str, request: MuteRequest) -> Done:
    return service.mute(episode, request.session, muted=request.muted)


@router.post("/episodes/{episode}/announce", summary="Say something to everybody in an episode")
async def announce(service: TheService, episode: str, request: AnnounceRequest) -> Done:
    return service.announce(episode, request.text)


@router.post("/announce", summary="Say something to everybody")
async def announce_to_all(service: TheService, request: AnnounceRequest) -> Done:
    return service.announce_to_all(request.text)


@router.get("/recordings", summary="The recordings, the newest first")
async def recordings(
    service: TheService, search: Search = "", limit: Limit = 50, offset: Offset = 0
) -> RecordingPage:
    return await service.recordings(search, limit, offset)


@router.get(
    "/recordings/{name}",
    summary="A recording, closed or up to its last whole frame",
    response_class=Response,
    responses=FILE,
)
async def recording(service: TheService, name: str) -> Response:
    content = await service.recording(name)
    headers = {"content-disposition": f'attachment; filename="{name}"'}
    return Response(content, media_type="application/octet-stream", headers=headers)


def _events(events: AsyncIterator[str]) -> StreamingResponse:
    return StreamingResponse(
        events,
        media_type="text/event-stream",
        headers={"x-accel-buffering": "no"},
    )


async def _refused(request: Request, error: Exception) -> Response:
    if not isinstance(error, RequestRefusedError):
        raise error
    if request.method not in SAFE or error.status is HTTPStatus.FORBIDDEN:
        service: AdminService = request.app.state.service.serving(request.state.principal)
        what = request.scope["route"].name.replace("_", " ")
        service.refused(what, request.path_params.get("episode", ""), error.code)
    return _problem(error.status, error.code, error.message)


async def _invalid(request: Request, error: Exception) -> Response:
    if not isinstance(error, RequestValidationError):
        raise error
    fault = error.errors()[0]
    where = ".".join(str(part) for part in fault["loc"][1:])
    message = f"{where or 'the body'}: {fault['msg']}"
    return _problem(HTTPStatus.BAD_REQUEST, "request/invalid", message)


async def _no_such_path(request: Request, error: Exception) -> Response:
    if not isinstance(error, HTTPException):
        raise error
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        message = f"{request.url.path} does not take {request.method}"
        return _problem(HTTPStatus.METHOD_NOT_ALLOWED, "request/method", message)
    message = f"there is no {request.url.path}"
    return _problem(HTTPStatus.NOT_FOUND, "request/unknown", message)


async def _failed(request: Request, error: Exception) -> Response:
    get_logger().error("the operator's view failed", path=request.url.path, exc_info=error)
    message = "this failed; the server's log says how"
    return _problem(HTTPStatus.INTERNAL_SERVER_ERROR, "operator/internal", message)


def _problem(status: HTTPStatus, code: str, message: str) -> Response:
    return JSONResponse(Problem(code=code, message=message).model_dump(), status)


class OperatorApi(FastAPI):
    """The application, described with what its gate asks for."""

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


def application(service: AdminService | None, streams: Streams | None) -> FastAPI:
    """The API of a service; without one it can only be described."""
    app = OperatorApi(
        title="Robotouille: the operator's view",
        version=API_VERSION,
        summary="See and steer the episodes of one server.",
        description=DESCRIPTION,
        docs_url=None,
        redoc_url=None,
        openapi_url="/api/openapi.json",
        generate_unique_id_function=lambda route: route.name,
    )
    app.state.service = service
    app.state.streams = streams
    app.include_router(router)
    app.router.routes.extend(page_routes())
    app.add_exception_handler(RequestRefusedError, _refused)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(HTTPException, _no_such_path)
    app.add_exception_handler(Exception, _failed)
    return app


def document() -> dict[str, Any]:
    """The OpenAPI document."""
    return application(None, None).openapi()
