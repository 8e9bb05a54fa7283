"""Episodes that operators open: the request of a study's host, many times, between steps."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterable, Iterator
from contextlib import suppress
from http import HTTPStatus

from robotouille.domain.loading import load_task, task_names
from robotouille.domain.task import Task, Timing
from robotouille.errors import FileError, ProtocolError
from robotouille.protocol import messages
from robotouille_server.operator.load import Turns
from robotouille_server.operator.models import OpenedEpisode, OpenRequest, TaskRow
from robotouille_server.operator.principal import RequestRefusedError
from robotouille_server.requests import Opening, Services, open_episode, simulate_plan
from robotouille_server.runtime.task_folder import TaskFolder
from robotouille_server.runtime.workers import ElsewhereError

STATUS = {
    "rate/episodes": HTTPStatus.TOO_MANY_REQUESTS,
    "server/draining": HTTPStatus.SERVICE_UNAVAILABLE,
    "server/full": HTTPStatus.SERVICE_UNAVAILABLE,
    "server/recording": HTTPStatus.SERVICE_UNAVAILABLE,
}
"""HTTP status of a refusal that is not about the request's options."""


def task_rows(own: TaskFolder) -> list[TaskRow]:
    """Return the tasks that an operator may open: those of the server's folder, then the shipped.

    Reading all files takes 0.1 s, so the caller does it in a thread.
    """
    shipped = [name for name in task_names() if name not in own.names]
    return [*_rows(_own_tasks(own)), *_rows(load_task(name, files=False) for name in shipped)]


def _own_tasks(own: TaskFolder) -> Iterator[Task]:
    for name in own.names:
        # The file may have changed since the server checked it.
        with suppress(FileError):
            if (task := own.load(name, None, Timing.BENCHMARK, 0)) is not None:
                yield task


def _rows(tasks: Iterable[Task]) -> Iterator[TaskRow]:
    for task in tasks:
        seats = list(task.problem.seats or (task.seats,))
        yield TaskRow(name=task.name, seats=seats, shift=task.problem.shift is not None)


async def open_episodes(
    services: Services, turns: Turns, request: OpenRequest, owner: str
) -> AsyncIterator[OpenedEpisode]:
    """Open episodes and yield each, in a turn of its own.

    Raises:
        ProtocolError: The server refuses to open another one.
    """
    opening = Opening(request=request.create, owner=owner)
    for _ in range(request.count):
        # Each episode creates a file and takes a few milliseconds.
        await turns.next()
        yield OpenedEpisode.of(await _open(services, opening))


async def _open(services: Services, opening: Opening) -> messages.Created:
    if services.cluster is not None:
        return await services.cluster.create(opening)
    await simulate_plan(services, opening.request)
    try:
        return open_episode(services, opening)[1]
    except ElsewhereError as error:
        # Only a rematch names an episode.
        raise ProtocolError("episode/unknown", str(error), "rematch") from None


def refused_opening(error: ProtocolError) -> RequestRefusedError:
    """Return the answer to a request whose first episode was refused."""
    status = STATUS.get(error.code, HTTPStatus.BAD_REQUEST)
    return RequestRefusedError(status, error.code, error.message, field=error.field)
