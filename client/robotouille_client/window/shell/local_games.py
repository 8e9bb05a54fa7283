"""Games that are played in this process, and the tutorial."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from robotouille.domain.loading import task_names
from robotouille.domain.task import Timing
from robotouille_client.bots.partners import MakePartners
from robotouille_client.window.forms.answers import Answer
from robotouille_client.window.shell.game_cards import LEAVE_BUTTONS, REVIEW_BUTTONS, GameCards
from robotouille_client.window.shell.games.local_game import GameSetup, LocalGame
from robotouille_client.window.shell.games.tutorial import TUTORIAL, TutorialSource
from robotouille_client.window.shell.replays import Replays
from robotouille_client.window.shell.screens.play_menu import PlayMenu
from robotouille_client.window.shell.user_interface import UserInterface
from robotouille_client.window.sources.task_titles import task_title

__all__ = ["LocalGames"]


class LocalGames:
    """Plays tasks here, with bots for partners.

    Args:
        replays: What shows and films the games that are over.
        recordings: Where they are kept, None to keep none.
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
        """Ask what is to be played, and play it."""
        self._ui.splash("Loading …")
        setup = await PlayMenu(self._ui.settings).ask(self._ui.ask)
        return None if setup is None else await self.play(setup)

    async def play(self, setup: GameSetup) -> object:
        """Play a task, again and again, or the next one, as long as that is asked for."""
        answer: object = Answer.AGAIN
        while answer in (Answer.AGAIN, Answer.NEXT):
            if answer == Answer.NEXT:
                setup = dataclasses.replace(setup, task=_following(setup.task), seats=None)
            self._ui.splash("Loading …")
            answer = await self._play_once(self._game(setup, self._recordings), setup)
        return answer

    async def learn(self) -> object:
        """The tutorial; the place to go to next."""
        self._ui.splash("Loading …")
        game = self._game(TUTORIAL, None)
        source = TutorialSource(game.source, self._ui.keys)

        def note_learned() -> None:
            self._ui.settings.learned = self._ui.settings.learned or source.finished
            self._ui.remember()

        cards = GameCards(
            lambda: game.source.outcome,
            lambda: [
                ("Play a game", Answer.PLAY),
                ("The tutorial again", Answer.TUTORIAL),
                ("Menu", Answer.MENU),
            ],
            ended=note_learned,
        )
        try:
            return await self._ui.show(source, cards, caption="Tutorial")
        finally:
            game.finish(over=False)
            note_learned()

    def _game(self, setup: GameSetup, recordings: Path | None) -> LocalGame:
        ui = self._ui
        return LocalGame(
            setup, ui.preferences.name, ui.clock, recordings, self._make_partners, ui.words
        )

    async def _play_once(self, game: LocalGame, setup: GameSetup) -> object:
        source = game.source

        def buttons() -> Sequence[tuple[str, object]]:
            of_it = REVIEW_BUTTONS if game.path is not None else ()
            return [
                ("Play again", Answer.AGAIN),
                ("Next task", Answer.NEXT),
                *of_it,
                *LEAVE_BUTTONS,
            ]

        cards = GameCards(
            lambda: source.outcome,
            buttons,
            source.stand_still,
            ended=partial(self._note_best, game),
        )
        show = partial(self._ui.show, source, cards, caption=task_title(setup.task))
        try:
            answer = await show()
        finally:
            path = game.finish(over=source.finished)
            self._note_best(game)
        if path is None:
            if answer in (Answer.WATCH, Answer.VIDEO):
                self._ui.message = "The game could not be kept."
            return answer
        watch, save = partial(self._replays.watch, path), partial(self._replays.save, path)
        return await self._replays.review(answer, cards, watch, save, show)

    def _note_best(self, game: LocalGame) -> None:
        """Write down in how few steps a task was done, in the timing that people play in."""
        task, outcome = game.world.task, game.source.outcome
        if outcome is None or outcome["reason"] != "goal" or task.timing is not Timing.PEOPLE:
            return
        best, name = self._ui.settings.best, f"{task.name}@{task.seats}"
        if task.name in task_names():
            best[name] = min(best.get(name, outcome["steps"]), outcome["steps"])
            self._ui.remember()


def _following(task: str) -> str:
    """The task after another in the list."""
    names = task_names()
    index = next((i for i, name in enumerate(names) if name.startswith(task)), -1)
    return names[(index + 1) % len(names)]
