"""Best results and stars of the player, which the menus show."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from robotouille.domain.loading import shipped_task
from robotouille.domain.task import Task, Timing
from robotouille_client.window.app.game_cards import only_watched, rate_game
from robotouille_client.window.app.settings import Settings
from robotouille_client.window.sources.texts import points_of


def note_result(
    settings: Settings,
    task: Task,
    step_seconds: float | None,
    outcome: Mapping[str, Any] | None,
    people: Collection[str],
) -> None:
    """Note the steps of a game, or the points of a shift, if they are the player's best.

    Args:
        people: Players at this window. Bots alone earn them nothing.
    """
    # The menus show results of shipped tasks in the timing of people only. Other files may share
    # a name.
    if outcome is None or task.timing is not Timing.PEOPLE or shipped_task(task) is None:
        return
    if only_watched(outcome, people):
        return
    name, points = f"{task.name}@{task.seats}", points_of(outcome)
    rating = rate_game(task, task.seats, step_seconds, outcome)
    if rating is not None:
        settings.stars[name] = max(settings.stars.get(name, 0), rating.stars)
    best = settings.best
    if points is not None:
        best[name] = max(best.get(name, 0), points)
    elif outcome.get("reason") == "goal":
        steps = int(outcome.get("steps", 0))
        best[name] = min(best.get(name, steps), steps)
