"""Setup of an episode: task and rules, from a `create` message and the settings."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache

from robotouille.certification.step_limit import needs_simulation, people_step_limit
from robotouille.domain.loading import load_task
from robotouille.domain.task import Task, Timing
from robotouille.episode import Chat, Rules, SeatTreatment
from robotouille.errors import FileError, ProtocolError, UnknownTaskError, did_you_mean
from robotouille.protocol import messages
from robotouille.world.world import shared_world
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.runtime.task_folder import TaskFolder


@dataclass(frozen=True, slots=True)
class EpisodeSetup:
    """Task and rules of an episode, and what a study adds to them.

    Attributes:
        task: The task.
        rules: The rules.
        seed: The seed with which the task was loaded.
        labels: The labels of the episode.
        treatments: The treatments of seats, by player.
    """

    task: Task
    rules: Rules
    seed: int
    labels: Mapping[str, str]
    treatments: Mapping[str, SeatTreatment]

    @classmethod
    def requested(
        cls, request: messages.Create, settings: ServerSettings, tasks: TaskFolder
    ) -> EpisodeSetup:
        """Return the setup that a message requests; omitted options come from the settings.

        Raises:
            ProtocolError: `task/unknown`, `task/invalid`, `seat/unknown` or
                `message/invalid-field`, with the field.
        """
        rules = _rules(request, settings)
        seed = request.seed if request.seed is not None else settings.seed
        task = _task(request, rules, seed, settings, tasks)
        rules = _with_step_limit(rules, task, request, settings)
        budget = request.move_budget
        if budget is None:
            budget = settings.move_budget
        rules = rules.with_budget(budget, task.seats)
        players = shared_world(task).players
        _check_players("treatments", request.treatments, players)
        _check_players("participants", request.participants, players)
        return cls(task, rules, seed, request.labels, request.treatments)


def task_to_simulate(
    request: messages.Create, settings: ServerSettings, tasks: TaskFolder
) -> Task | None:
    """Return the task of an episode if its step limit needs the simulation of a plan, else None.

    Raises:
        ProtocolError: The request is invalid, as in `EpisodeSetup.requested`.
    """
    if _has_step_limit(request, settings):
        return None
    seed = request.seed if request.seed is not None else settings.seed
    task = _task(request, _rules(request, settings), seed, settings, tasks)
    return task if task.timing is Timing.PEOPLE and needs_simulation(task) else None


def _rules(request: messages.Create, settings: ServerSettings) -> Rules:
    asked = {
        "clock": request.clock,
        "step_rate": request.step_rate,
        "max_steps": request.max_steps,
        "thinking": request.thinking,
        "absence": request.absence,
        "substitute": request.substitute,
        "grace": request.grace,
        "open_for": request.open_for,
        "chat": request.chat,
        "phrases": tuple(request.phrases) or None,
        "sight": request.sight,
        "sight_blocked": request.sight_blocked,
    }
    changes = {key: value for key, value in asked.items() if value is not None}
    rules = settings.rules().model_copy(update=changes)
    if (rules.chat is Chat.PHRASES) != bool(rules.phrases):
        message = "'phrases' needs the chat 'phrases', which needs at least one phrase"
        raise ProtocolError("message/invalid-field", message, "phrases")
    return rules


def _has_step_limit(request: messages.Create, settings: ServerSettings) -> bool:
    """Return whether the request or the operator chooses the step limit."""
    return request.max_steps is not None or "max_steps" in settings.model_fields_set


def _with_step_limit(
    rules: Rules, task: Task, request: messages.Create, settings: ServerSettings
) -> Rules:
    """Replace the default step limit of a task with people's timing by a suitable one."""
    if _has_step_limit(request, settings) or (
        task.timing is not Timing.PEOPLE and task.problem.shift is None
    ):
        return rules
    limit = people_step_limit(task, rules.step_rate if rules.scheduled else None)
    return rules if limit is None else rules.model_copy(update={"max_steps": limit})


def _task(
    request: messages.Create, rules: Rules, seed: int, settings: ServerSettings, tasks: TaskFolder
) -> Task:
    name = request.task or settings.task
    timing = request.timing or settings.timing_for(rules.clock)
    seats = request.seats if request.seats is not None else settings.seats
    # The setting for seats applies to the default task only. Other tasks have defaults of their
    # own.
    if request.task is not None and request.seats is None:
        seats = None
    try:
        # The operator's own tasks come first, so an operator can replace a shipped task.
        own = tasks.load(name, seats, timing, seed)
        if own is not None:
            return own
        if request.task is None:
            return load_task(name, seats=seats, timing=timing, seed=seed)
        # `_shipped` uses `files=False`, so that no name in a message is read as a path on the
        # server.
        return _shipped(name, seats, timing, seed)
    except UnknownTaskError as error:
        near = did_you_mean(name.partition("@")[0], tasks.names)
        message = f"unknown task {name!r}{near}" if near else str(error)
        raise ProtocolError("task/unknown", message, "task") from None
    except FileError as error:
        fault = error.faults[0]
        field = "seats" if fault.path == "seats" else "task"
        raise ProtocolError("task/invalid", str(fault), field) from None


def _shipped(name: str, seats: int | None, timing: Timing, seed: int) -> Task:
    """Return a shipped task. Its files do not change while the server runs."""
    # Rooms usually differ in their seeds, but few tasks depend on the seed.
    task = _loaded(name, seats, timing, 0)
    return _loaded(name, seats, timing, seed) if task.seeded else task


@lru_cache(maxsize=256)
def _loaded(name: str, seats: int | None, timing: Timing, seed: int) -> Task:
    return load_task(name, seats=seats, timing=timing, seed=seed, files=False)


def _check_players(field: str, named: Iterable[str], players: Collection[str]) -> None:
    for player in named:
        if player not in players:
            message = f"unknown seat {player!r}; the seats are {', '.join(players)}"
            raise ProtocolError("seat/unknown", message, field)
