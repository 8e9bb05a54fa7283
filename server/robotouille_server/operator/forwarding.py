"""Requests of operators that one node of a cluster forwards to another, as messages.

A message is a line of JSON, which is the header, and then the body of the request or the answer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from http import HTTPStatus
from math import isfinite
from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from robotouille_server.auth import Role, RoleGrant
from robotouille_server.cluster.members import NodeReport
from robotouille_server.operator.models import Problem
from robotouille_server.operator.principal import Principal, RequestRefusedError

ANSWER_SECONDS = 5.0
"""Seconds that another node has to answer a request."""
MAX_REQUEST_BYTES = 64 * 1024
MAX_ANSWER_BYTES = 960 * 1024
"""Bytes of an answer. NATS refuses messages above 1 MiB."""
PASSED_ON = frozenset({"content-type", "content-disposition", "retry-after"})
"""Headers of answers that the asking node passes on."""

_M = TypeVar("_M", bound=BaseModel)


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class ForwardedGrant(_Message):
    """Limits of the token with which an operator has sent a request.

    The token itself is not sent, because whoever reads the messages could use it. `expires` is 0 if
    it does not expire.
    """

    subject: str = Field(min_length=1, max_length=200)
    episode: str = Field("", max_length=64)
    token_id: str = Field("", max_length=200)
    expires: float = 0.0


class RequestHeader(_Message):
    """Header of a forwarded request.

    Attributes:
        node: The name of the node that has checked the operator's token.
        by: The operator; `local` is a program on that node's machine that needs no token.
    """

    node: str = Field(min_length=1, max_length=64)
    by: ForwardedGrant | Literal["local"]
    method: Literal["GET", "POST"]
    path: str = Field(pattern="^/api/", max_length=1000)
    query: str = Field("", max_length=4000)


class AnswerHeader(_Message):
    """Header of an answer."""

    status: int = Field(ge=200, le=599)
    headers: dict[
        Literal["content-type", "content-disposition", "retry-after"],
        Annotated[str, Field(pattern=r"^[ -~]*$", max_length=300)],
    ] = {}


@dataclass(frozen=True, slots=True)
class NodeRequest:
    """Request for another node."""

    method: Literal["GET", "POST"]
    path: str
    query: str = ""
    body: bytes = b""


@dataclass(frozen=True, slots=True)
class NodeAnswer:
    """Answer of another node."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    def checked(self) -> bytes:
        """Return the body; raise RequestRefusedError if the other node has refused the request."""
        if self.status == HTTPStatus.OK:
            return self.body
        try:
            problem = Problem.model_validate_json(self.body)
            status = HTTPStatus(self.status)
        except ValueError:
            raise unreadable() from None
        raise RequestRefusedError(status, problem.code, problem.message, self._retry_seconds)

    @property
    def _retry_seconds(self) -> int | None:
        text = self.headers.get("retry-after", "")
        return int(text) if text.isascii() and text.isdigit() else None


def unreadable() -> RequestRefusedError:
    """Return the refusal for an answer that cannot be read."""
    message = "the episode's node has sent an answer that this one cannot read"
    return RequestRefusedError(HTTPStatus.BAD_GATEWAY, "node/unavailable", message)


def too_large(node: NodeReport) -> RequestRefusedError:
    """Return the refusal of a node whose answer does not fit into a message."""
    message = (
        f"the answer is too large to be forwarded; use the operator page of the node {node.url}: "
        f"{node.operator}"
    )
    return RequestRefusedError(HTTPStatus.BAD_GATEWAY, "node/size", message)


def encode_request(node: str, principal: Principal, request: NodeRequest) -> bytes:
    """Return a request as a message.

    Raises:
        RequestRefusedError: It is too large.
    """
    grant = principal.grant
    by: ForwardedGrant | Literal["local"] = "local"
    if grant is not None:
        by = ForwardedGrant(
            subject=grant.subject,
            episode=grant.episode,
            token_id=grant.token_id,
            expires=grant.expires if isfinite(grant.expires) else 0.0,
        )
    try:
        header = RequestHeader(
            node=node, by=by, method=request.method, path=request.path, query=request.query
        )
        data = header.model_dump_json().encode() + b"\n" + request.body
    except ValidationError:
        data = b""
    if not 0 < len(data) <= MAX_REQUEST_BYTES:
        message = "the request is too large to be sent to the episode's node"
        raise RequestRefusedError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "request/size", message)
    return data


def decode_request(data: bytes) -> tuple[RequestHeader, bytes]:
    """Return the header and the body of a request; raise ValueError if it is invalid."""
    if len(data) > MAX_REQUEST_BYTES:
        raise ValueError("too large")
    return _decoded(data, RequestHeader)


def encode_answer(answer: NodeAnswer) -> bytes:
    """Return an answer as a message."""
    known = {name: text for name, text in answer.headers.items() if name in PASSED_ON}
    header = AnswerHeader.model_validate({"status": answer.status, "headers": known})
    return header.model_dump_json().encode() + b"\n" + answer.body


def decode_answer(data: bytes) -> NodeAnswer:
    """Return an answer; raise ValueError if it is invalid."""
    header, body = _decoded(data, AnswerHeader)
    return NodeAnswer(header.status, {str(k): v for k, v in header.headers.items()}, body)


def _decoded(data: bytes, model: type[_M]) -> tuple[_M, bytes]:
    header, newline, body = data.partition(b"\n")
    if not newline:
        raise ValueError("no header")
    return model.model_validate_json(header), body


def granted(by: ForwardedGrant) -> RoleGrant:
    """Return the grant of an operator on another node."""
    return RoleGrant(
        Role.OPERATOR,
        by.subject,
        episode=by.episode,
        expires=by.expires,
        token_id=by.token_id,
    )
