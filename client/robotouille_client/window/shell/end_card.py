"""What one sees when a game is over: won or not, how well, who did what, and what comes next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from robotouille.certification.certificate import load_certificate
from robotouille.certification.step_limit import retimed_length
from robotouille.domain.loading import load_task
from robotouille.domain.task import Task, Timing
from robotouille.errors import RobotouilleError
from robotouille_client.window.forms.answers import Answer
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Button, Row, Words
from robotouille_client.window.pictures.theme import BAD, GOOD
from robotouille_client.window.shell.shares import SeatShare, ShareRow
from robotouille_client.window.sources.texts import outcome_words
from robotouille_client.window.view import View

__all__ = ["best_words", "end_card"]


def end_card(
    view: View, outcome: Mapping[str, Any] | None, buttons: Sequence[tuple[str, object]]
) -> Form:
    """The card of a game that is over.

    Args:
        view: The last that was shown.
        outcome: How it ended, as recordings and servers tell it; None if nobody knows.
        buttons: Words and answers, the first of which is the one of Enter.
    """
    rows: list[Row] = []
    if outcome is not None:
        rows.append(Words(f"{outcome_words(outcome)}."))
        if words := best_words(view.world.task):
            rows.append(Words(words))
        names = {seat.player: seat.name for seat in view.seats}
        for seat in outcome.get("seats", ()):
            player = str(seat.get("player", ""))
            you = " (you)" if player == view.me else ""
            rows.append(ShareRow(SeatShare.of((names.get(player) or player) + you, seat)))
    elif view.farewell is not None:
        rows.append(Words(f"{view.farewell.title}. {view.farewell.text}"))
    rows += [Button(label, answer) for label, answer in buttons]
    title = "Done!" if view.won else "The game is over" if outcome is None else "Not done this time"
    return Form(title, rows, cancel=Answer.MENU, accent=GOOD if view.won else BAD, shrinks=True)


def best_words(task: Task) -> str:
    """In how many steps it can be done, by the shortest plan that is known; empty where none is.

    A plan that is proven to be the shortest is so in the benchmark's timing; in that of people,
    where walks and work take longer, it is a good one. It lies beside the task's file, which one
    that a server has sent does not have: it is looked up by the name.
    """
    try:
        shipped = load_task(task.name, seats=task.seats, timing=task.timing)
        certificate = load_certificate(load_task(task.name, seats=task.seats))
    except (RobotouilleError, OSError):
        return ""
    length = retimed_length(shipped) if shipped.digest == task.digest else None
    if length is None:
        return ""
    if task.timing is Timing.BENCHMARK and certificate.optimal:
        return f"Proven best: {length} steps."
    return f"A very good game takes {length} steps."
