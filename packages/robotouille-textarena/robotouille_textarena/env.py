"""TextArena game of one kitchen. All players win and lose together."""

from __future__ import annotations

import re
from typing import Any

import textarena as ta

from robotouille.errors import WrongArgumentError
from robotouille_evaluation.text_games import GameOptions, TextGame, load_instance

AGENT = "react-none"
"""Strategy that only makes prompts and reads answers: TextArena's players keep the history."""

BRACKETS = re.compile(r"\[([^\[\]\n]{1,200})\]")
HEADING = re.compile(r"\baction\b", re.IGNORECASE)

NO_LIMIT = 10**9
"""Invalid moves that TextArena allows. The game counts them itself."""


class RobotouilleTextEnv(ta.Env):
    """Game whose players act at the same time, each in its turn before the step.

    Args:
        task: Name of a shipped task.
        partner: `planner` lets a planner play all players but the first.
    """

    def __init__(self, task: str = "synchronous/01", partner: str = "") -> None:
        super().__init__()
        self._task = task
        self._options = GameOptions(agent=AGENT, control="each", partner=partner)
        self._game: TextGame | None = None
        self._met: set[str] = set()

    def reset(self, num_players: int, seed: int | None = None) -> None:
        """Begin a game.

        Args:
            num_players: Players of the kitchen, or 1 with partners.
            seed: Seed of a new instance; without it, the task's own layout.

        Raises:
            RobotouilleError: The task is not for this many players, or the seed is invalid.
        """
        seats = None if self._options.partner else num_players
        if self._options.partner and num_players != 1:
            raise WrongArgumentError(f"a game with partners has 1 player, not {num_players}")
        name = self._task if seed is None else f"{self._task}#{seed}"
        self._game = TextGame(load_instance(name, seats), self._options)
        self._met = set()
        self.state = ta.MinimalMultiPlayerState(
            num_players=num_players, seed=seed, error_allowance=NO_LIMIT
        )
        self.state.reset()
        self._show_next()

    def step(self, action: str) -> tuple[bool, dict[str, Any]]:
        """Take a player's answer, and return whether the game is over.

        The information has the reward of the answer and, after the end, the score.

        Raises:
            WrongArgumentError: No game has begun.
        """
        game = self._playing()
        if self.state.done:
            return True, {}
        player = self.state.current_player_id
        self.state.add_observation(
            from_id=player,
            to_id=player,
            message=action,
            observation_type=ta.ObservationType.PLAYER_ACTION,
        )
        self.state.step_info = {"reward": game.answer(game.headed(without_brackets(action)))}
        if game.request is None:
            self._end()
        else:
            # A rejected answer is not a turn.
            self.state.made_invalid_move = bool(game.feedback)
            self._show_next()
        ended: tuple[bool, dict[str, Any]] = self.state.step()
        return ended

    def get_board_str(self) -> str:
        """Return the kitchen as the current player sees it."""
        game = self._playing()
        return game.state.text_view(game.player)

    def close(self) -> tuple[dict[int, float] | None, dict[int, dict[str, Any]]]:
        """End the game, and return rewards and information by player."""
        self._playing().close()
        found: tuple[dict[int, float] | None, dict[int, dict[str, Any]]] = self.state.close()
        return found

    def _playing(self) -> TextGame:
        if self._game is None:
            raise WrongArgumentError("no game has begun; call reset first")
        return self._game

    def _show_next(self) -> None:
        """Show the next request to its player, with the prompts when it is asked first."""
        game = self._playing()
        number = game.world.players.index(game.player)
        self.state.manually_set_current_player_id(number, force=True)
        if game.player not in self._met and game.request is not None:
            self._met.add(game.player)
            prompts = "\n\n".join(each.content for each in game.request.messages[:-1])
            self._show(number, prompts, ta.ObservationType.PROMPT)
        self._show(number, game.text, ta.ObservationType.GAME_BOARD)

    def _show(self, number: int, text: str, kind: ta.ObservationType) -> None:
        self.state.add_observation(to_id=number, message=text, observation_type=kind)

    def _end(self) -> None:
        score = self._playing().score
        reason = f"{score.ended or 'end'} after {score.steps} of {score.budget} steps"
        rewards = dict.fromkeys(range(self.state.num_players), score.reward)
        self.state.set_game_outcome(rewards, reason)
        self.state.step_info["score"] = score.as_json()


def without_brackets(text: str) -> str:
    """Return the last text in square brackets, TextArena's form of a move, as an action.

    Answers in the form that the prompt asks for stay unchanged.
    """
    if HEADING.search(text):
        return text
    found = BRACKETS.findall(text)
    return f"Action: {found[-1]}" if found else text
