"""Two minutes that teach by doing: one sentence at a time, each waits until it is done.

The words are made from the domain's own actions: nothing here knows what a kitchen is.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

from robotouille.certification.certificate import load_certificate
from robotouille.domain.rendering import language_of
from robotouille.episode.rules import Clock
from robotouille.errors import RobotouilleError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.people.usefulness import work_in_progress
from robotouille.world.people.wording import Wording
from robotouille.world.scene import scene
from robotouille.world.world import State, World
from robotouille_client.window.hands.commands import Command, KeyMap
from robotouille_client.window.shell.games.local_game import GameSetup
from robotouille_client.window.view import Source, View

__all__ = ["TUTORIAL", "Lesson", "TutorialSource", "kind_of"]

TUTORIAL = GameSetup("training/01", clock=Clock.TURN, max_steps=500)
"""What is played: nothing hurries, and the task is a small one."""

Kind = Literal["walk", "take", "put", "work"]


@dataclass(frozen=True, slots=True)
class Lesson:
    """What is to be done, and how one does it."""

    kind: Kind
    words: str


def lessons(keys: KeyMap, world: World) -> tuple[Lesson, ...]:
    """All of it, in order; what is to be worked on is what a proven plan works on first."""
    use = keys.words(Command.USE)
    work = _first_work(world)
    bring = f"take {work}" if work else "bring something"
    until = " until it is done" if work else ""
    return (
        Lesson("walk", "Walk to another place: press an arrow key, or click on the place."),
        Lesson("take", f"Walk to something that lies there and take it: {use}, or a click."),
        Lesson("put", f"Carry it somewhere else and put it down: {use}, or a click there."),
        Lesson("work", f"Some places are for work: {bring}, put it down, press {use}{until}."),
    )


class TutorialSource:
    """A source whose views have a lesson; all else is another source's."""

    def __init__(self, source: Source, keys: KeyMap) -> None:
        self._source = source
        self._lessons = list(lessons(keys, source.view().world))
        self._worked: tuple[State, GroundAction] | None = None
        self._taken_from: State | None = None
        self._goal_key = keys.words(Command.LIST)

    @property
    def lesson(self) -> Lesson | None:
        """The one that is to be done now; None when all are."""
        return self._lessons[0] if self._lessons else None

    def view(self) -> View:
        view = self._source.view()
        self._finish_work(view.state)
        return dataclasses.replace(view, lesson=self._words(view))

    def act(self, action: GroundAction) -> None:
        """Act; a valid action of the lesson's kind is the lesson done, but for one that puts a
        thing back where it was."""
        state, lesson = self._source.view().state, self.lesson
        valid = action.player is not None and action in state.actions(action.player)
        kind = kind_of(state, action) if valid else None
        if kind == "take":
            self._taken_from = state
        if lesson is not None and kind == lesson.kind and not self._undoes(state, action):
            if lesson.kind == "work":
                self._worked = state, action
            else:
                self._lessons.pop(0)
        self._source.act(action)

    def _undoes(self, state: State, action: GroundAction) -> bool:
        """Whether an action puts what is in hand back to where it was taken from."""
        if self._taken_from is None:
            return False
        after = state.world.successor(state, action)
        before, put = scene(self._taken_from), scene(after)
        freed = _held(state, action.player) - _held(after, action.player)
        return any(name in before and before[name].tile == put[name].tile for name in freed)

    def _finish_work(self, state: State) -> None:
        """Work is done when nothing of it is in progress any more."""
        if self._worked is None or state is self._worked[0]:
            return
        _, action = self._worked
        under_way = {(row.action, row.subject) for row in work_in_progress(state)}
        if not any((action.name, name) in under_way for name in action.arguments):
            self._lessons, self._worked = self._lessons[1:], None

    def say(self, text: str) -> None:
        self._source.say(text)

    @property
    def finished(self) -> bool:
        return self._source.finished

    def _words(self, view: View) -> str:
        if view.outcome:
            return ""
        if self.lesson is not None:
            return self.lesson.words
        goal = view.world.task.goal_description
        return f"Now the whole task: {goal} {self._goal_key} lists all you can do."


def _first_work(world: World) -> str:
    """`the tomato to the board`; nothing where no plan is known."""
    certificate = load_certificate(world.task)
    state = world.initial
    for line in (certificate.plan or ()) if certificate else ():
        try:
            action = world.parse(state, world.players[0], line)
        except RobotouilleError:
            return ""
        if kind_of(state, action) == "work":
            wording = Wording(world, language_of(world.task), action.player)
            places = [n for n in action.arguments if n in world.floor.stations]
            things = [n for n in action.arguments if n not in (*places, action.player)]
            if not (places and things):
                return ""
            thing = wording.thing(things[0], world.initial)
            return f"{thing} to {wording.place(places[0], world.initial)}"
        state = state.step(action).state
    return ""


def kind_of(state: State, action: GroundAction) -> Kind:
    """What an action is, by what it changes: where its player is, or what is held."""
    if action.destination is not None:
        return "walk"
    before = _held(state, action.player)
    after = _held(state.world.successor(state, action), action.player)
    if before == after:
        return "work"
    return "take" if len(after) > len(before) else "put"


def _held(state: State, player: str | None) -> set[str]:
    return {name for name, placed in scene(state).items() if placed.host == player}
