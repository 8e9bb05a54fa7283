"""Local games and the tutorial."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from robotouille.certification.certificate import load_certificate
from robotouille.domain.loading import load_task, task_names
from robotouille.domain.rendering import language_of
from robotouille.episode.rules import Clock
from robotouille.errors import RobotouilleError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.wording import Wording
from robotouille.world.presentation.work import work_in_progress
from robotouille.world.scene import scene
from robotouille.world.world import State, World
from robotouille_client.bots.partners import MakePartners
from robotouille_client.window.app.game_cards import (
    LEAVE_BUTTONS,
    REVIEW_BUTTONS,
    GameCards,
    rate_game,
)
from robotouille_client.window.app.introductions import introduction
from robotouille_client.window.app.level_map import ALL_TASKS, LevelMap
from robotouille_client.window.app.local_game import GameSetup, LocalGame
from robotouille_client.window.app.play_menu import PlayMenu
from robotouille_client.window.app.replays import Replays
from robotouille_client.window.app.results import note_result
from robotouille_client.window.app.settings import is_shift
from robotouille_client.window.app.user_interface import UserInterface
from robotouille_client.window.forms.rows import MenuChoice
from robotouille_client.window.input.commands import Command, KeyMap
from robotouille_client.window.sources.texts import task_title, won
from robotouille_client.window.view import GameSource, View

TUTORIAL = GameSetup("training/01", clock=Clock.TURN, max_steps=500)
"""Game of the tutorial: a small task without time pressure."""

EASY_RATE = 3.0
"""Steps per second of the pace that is offered after a lost first game."""

WALKING = (Command.UP, Command.LEFT, Command.DOWN, Command.RIGHT)
"""Commands that walk, in the order in which people say their keys."""

Kind = Literal["walk", "take", "put", "work"]


@dataclass(frozen=True, slots=True)
class Lesson:
    """Kind of action to try, and the instruction for it."""

    kind: Kind
    words: str


PUT_BACK = "That's where you took it from. Take it again, then carry it to another table."
"""Lesson after a thing was put back, which completes no lesson."""


def lessons(keys: KeyMap, world: World) -> tuple[Lesson, ...]:
    """Return the lessons in order. The work to try is the first work of a known plan."""
    use = keys.words(Command.USE)
    walk = " ".join(keys.words(each) for each in WALKING)
    work = _first_work(world)
    bring = f"take {work}" if work else "take something to a station where you can work"
    until = " until it's done" if work else ""
    return (
        Lesson("walk", f"Let's walk! Press {walk} or the arrow keys, or click on a station."),
        Lesson("take", f"Walk to an ingredient and take it: press {use}, or click."),
        Lesson("put", f"Carry it to an empty table and put it down: press {use}, or click."),
        Lesson("work", f"Time to work: {bring}, put it down, and press {use}{until}."),
    )


class TutorialSource(GameSource):
    """Source that adds lessons to the views of another source."""

    def __init__(self, source: GameSource, keys: KeyMap) -> None:
        self._source = source
        self._lessons = list(lessons(keys, source.view().world))
        self._worked: tuple[State, GroundAction] | None = None
        self._taken_from: State | None = None
        self._put_back = False
        self._list_key = keys.words(Command.LIST)

    @property
    def lesson(self) -> Lesson | None:
        """The current lesson; None after the last one."""
        return self._lessons[0] if self._lessons else None

    def view(self) -> View:
        view = self._source.view()
        self._finish_work(view.state)
        return dataclasses.replace(view, lesson=self._words(view))

    def act(self, action: GroundAction) -> None:
        """Submit an action. A valid action of the lesson's kind completes the lesson.

        Putting a thing back where it was does not complete one.
        """
        state, lesson = self._source.view().state, self.lesson
        valid = action.player is not None and action in state.actions(action.player)
        kind = kind_of(state, action) if valid else None
        # This is remembered, because putting the thing back would otherwise complete the next
        # lesson.
        undone = kind == "put" and self._undoes(state, action)
        if kind == "take":
            self._taken_from = state
        if kind in ("take", "put"):
            self._put_back = undone
        if lesson is not None and kind == lesson.kind and not undone:
            if lesson.kind == "work":
                self._worked = state, action
            else:
                self._lessons.pop(0)
        self._source.act(action)

    def _undoes(self, state: State, action: GroundAction) -> bool:
        """Return whether an action puts the held thing back where it was taken."""
        if self._taken_from is None:
            return False
        after = state.world.successor(state, action)
        before, put = scene(self._taken_from), scene(after)
        freed = _held(state, action.player) - _held(after, action.player)
        return any(name in before and before[name].tile == put[name].tile for name in freed)

    def _finish_work(self, state: State) -> None:
        """Complete the work lesson when the work is no longer in progress."""
        if self._worked is None or state is self._worked[0]:
            return
        _, action = self._worked
        # Work such as cutting takes several actions. The lesson ends when nothing is left to cut.
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
            again = self._put_back and self.lesson.kind == "put"
            return PUT_BACK if again else self.lesson.words
        goal = view.world.task.goal_description
        stack = "Stack what the ticket shows from the bottom up."
        return f"{goal} {stack} {self._list_key} lists all actions."


def _first_work(world: World) -> str:
    """Return the first work of a known plan, such as `the tomato to the board`; else ""."""
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
    """Return the kind of an action from what it changes: the player's station, or what is held."""
    # The names of actions differ between domains, so only their effects are compared.
    if action.destination is not None:
        return "walk"
    before = _held(state, action.player)
    after = _held(state.world.successor(state, action), action.player)
    if before == after:
        return "work"
    return "take" if len(after) > len(before) else "put"


def _held(state: State, player: str | None) -> set[str]:
    return {name for name, placed in scene(state).items() if placed.host == player}


class LocalGames:
    """Menu entries for local games and the tutorial.

    Args:
        recordings: Folder for recordings; None to keep none.
    """

    def __init__(
        self,
        ui: UserInterface,
        replays: Replays,
        recordings: Path | None,
        make_partners: MakePartners,
    ) -> None:
        self._ui = ui
        self._replays = replays
        self._recordings = recordings
        self._make_partners = make_partners

    async def choose(self) -> object:
        """Let the player choose a game, and play it."""
        self._ui.splash("Loading …")
        setup = await PlayMenu(self._ui.settings).ask(self._ui.ask)
        return None if setup is None else await self.play(setup)

    async def choose_level(self) -> object:
        """Let the player choose a level on the map, set up the game, and play it."""
        last = ""
        while True:
            self._ui.splash("Loading …")
            picked = await self._ui.ask(LevelMap(self._ui.settings, last))
            if picked == MenuChoice.TUTORIAL:
                return picked
            if picked == ALL_TASKS:
                return await self.choose()
            if picked == "back":
                return None
            last = self._ui.settings.task = str(picked)
            setup = await PlayMenu(self._ui.settings).ask(self._ui.ask)
            if setup is None:
                continue
            answer = await self.play(setup)
            # The new star, and what it opens, are on the map.
            if answer != MenuChoice.MENU:
                return answer

    async def play(self, setup: GameSetup) -> object:
        """Play a task, and play it again or continue with the next one until the player stops."""
        answer: object = MenuChoice.AGAIN
        seats = setup.seats or setup.load().seats
        while answer in (MenuChoice.AGAIN, MenuChoice.SLOWER, MenuChoice.NEXT):
            if answer == MenuChoice.SLOWER:
                setup = dataclasses.replace(setup, rate=EASY_RATE)
                self._ui.settings.rate = EASY_RATE
                self._ui.remember()
            if answer == MenuChoice.NEXT:
                task = _following(setup.task)
                setup = dataclasses.replace(setup, task=task, seats=_allowed(task, seats), seed=0)
            self._ui.splash("Loading …")
            game = self._game(setup, self._recordings)
            answer = await self._play_once(game, setup)
            if game.world.shift is not None:
                # A shift whose orders are known by heart is no longer a surprise.
                setup = dataclasses.replace(setup, seed=setup.seed + 1)
        return answer

    async def learn(self) -> object:
        """Play the tutorial; return what to show next."""
        self._ui.splash("Loading …")
        # The tutorial is not recorded, because only the newest recordings are kept.
        game = self._game(TUTORIAL, None)
        source = TutorialSource(game.source, self._ui.keys)

        def note_learned() -> None:
            self._ui.settings.learned = self._ui.settings.learned or source.finished
            self._ui.remember()

        cards = GameCards(
            lambda: game.source.outcome,
            lambda: [
                ("Play a game", MenuChoice.LEVELS),
                ("Repeat the tutorial", MenuChoice.TUTORIAL),
                ("Menu", MenuChoice.MENU),
            ],
            ended=note_learned,
        )
        try:
            return await self._ui.show(source, cards, caption="Tutorial")
        finally:
            game.finish(ended=False)
            note_learned()

    def _game(self, setup: GameSetup, recordings: Path | None) -> LocalGame:
        ui = self._ui
        return LocalGame(
            setup,
            ui.preferences.name,
            ui.time_source.clock,
            recordings,
            self._make_partners,
            ui.words,
        )

    async def _play_once(self, game: LocalGame, setup: GameSetup) -> object:
        source = game.source

        def buttons() -> Sequence[tuple[str, object]]:
            of_it = REVIEW_BUTTONS if game.path is not None else ()
            slower = [("Play again at an easy pace", MenuChoice.SLOWER)]
            return [
                *(slower if self._overtaxed(setup, game) else []),
                ("Play again", MenuChoice.AGAIN),
                ("Next task", MenuChoice.NEXT),
                *of_it,
                *LEAVE_BUTTONS,
            ]

        cards = GameCards(
            lambda: source.outcome,
            buttons,
            source.pause,
            ended=partial(self._note_best, game),
            start=introduction(game.world, self._ui.words),
        )
        show = partial(self._ui.show, source, cards, caption=task_title(setup.task))
        try:
            answer = await show()
        finally:
            # This also happens when the window is closed: a finished game stays in the list of
            # replays.
            path = game.finish(ended=source.finished)
            self._note_best(game)
        if path is None:
            if answer in (MenuChoice.WATCH, MenuChoice.VIDEO):
                self._ui.message = "The recording could not be saved."
            return answer
        watch, save = partial(self._replays.watch, path), partial(self._replays.save, path)
        return await self._replays.review(answer, cards, watch, save, show)

    def _overtaxed(self, setup: GameSetup, game: LocalGame) -> bool:
        """Return whether a player without any success has lost a game that could be slower."""
        fast = setup.clock is Clock.REALTIME and setup.rate > EASY_RATE
        outcome, settings, task = game.source.outcome, self._ui.settings, game.world.task
        if outcome is None or not fast:
            return False
        rating = rate_game(task, task.seats, game.step_seconds, outcome)
        lost = not won(outcome) or (rating is not None and not rating.stars)
        # A shift also has a best result without a star.
        solved = any(not is_shift(name) for name in settings.best)
        return lost and not solved and not any(settings.stars.values())

    def _note_best(self, game: LocalGame) -> None:
        """Save the result if it is the player's best."""
        note_result(
            self._ui.settings,
            game.world.task,
            game.step_seconds,
            game.source.outcome,
            game.people,
        )
        self._ui.remember()


def _following(task: str) -> str:
    names = task_names()
    index = next((i for i, name in enumerate(names) if name.startswith(task)), -1)
    return names[(index + 1) % len(names)]


def _allowed(name: str, wanted: int) -> int:
    """Return the number of players that a task allows, as many as wanted or the next lower one."""
    task = load_task(name)
    counts = task.problem.seats or (task.seats,)
    return max((count for count in counts if count <= wanted), default=min(counts))
