"""Episodes that are played by texts: the game asks, and the caller brings the model's answers.

    game = TextGame(load_instance("synchronous/01"))
    while game.request is not None:
        game.answer(ask(game.request.messages))
    print(game.score)

Prompts, parsing, feedback and step budget are those of `robotouille benchmark run`.
"""

from __future__ import annotations

import math
from collections.abc import Coroutine, Generator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, get_args

from robotouille import State, World
from robotouille.domain.schema import DomainFile
from robotouille.errors import WrongArgumentError
from robotouille_evaluation.agents.answers import TolerantParser
from robotouille_evaluation.agents.custom import is_custom
from robotouille_evaluation.agents.joint_team import JointTeam
from robotouille_evaluation.agents.making import OWN_STRATEGIES, make_strategy, team_strategy
from robotouille_evaluation.agents.proposal import Complete, Strategy, answer_all
from robotouille_evaluation.agents.react import FEEDBACK
from robotouille_evaluation.agents.team import Control, IndependentTeam, Team, TurnsTeam
from robotouille_evaluation.models.model import Completion, ModelRequest, valid_actions
from robotouille_evaluation.models.responses import cut_answer, encodable
from robotouille_evaluation.packs.own import prompts_of
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.runs.episode_runner import EpisodeRunner, RecordedRunner, episode_rules
from robotouille_evaluation.runs.job_agents import planner
from robotouille_evaluation.runs.text_episode import EndReason, TextEpisode, play_team
from robotouille_evaluation.text_games.instances import GameInstance, require_known
from robotouille_evaluation.text_games.score import GameScore, Progress

CONVERSATION = "react-full"
"""Strategy whose requests only ever grow, so that an episode is one conversation."""

PARTNERS = ("", "planner")

MAX_ALONE = 1000
"""Characters of the longest answer that may be an action without heading."""


@dataclass(frozen=True, slots=True)
class GameOptions:
    """Options of a game.

    Attributes:
        agent: Strategy that asks the model: one of `OWN_STRATEGIES`, or `MODULE:NAME`.
        control: With several players: `turns` asks for one player after the other, `joint` once for
            all, and `each` has a conversation for each player.
        partner: `planner` lets a planner play all players but the first; empty if the model plays
            all of them.
        dense: Reward progress after each answer. Otherwise only the goal is rewarded, and points.

    Raises:
        WrongArgumentError: An option is unknown.
    """

    agent: str = CONVERSATION
    control: Control = "turns"
    partner: str = ""
    dense: bool = True

    def __post_init__(self) -> None:
        agents = OWN_STRATEGIES if not is_custom(self.agent) else (self.agent,)
        require_known("agent", self.agent, agents)
        require_known("control", self.control, get_args(Control))
        require_known("partner", self.partner, PARTNERS)


class _Question(NamedTuple):
    """Request to the model of a player."""

    player: str
    request: ModelRequest


class _Asked:
    """Awaitable that passes a question to the caller of the game."""

    def __init__(self, question: _Question) -> None:
        self._question = question

    def __await__(self) -> Generator[_Question, Completion, Completion]:
        answer = yield self._question
        return answer


@lru_cache(maxsize=8)
def _prompts(domain: str, shifts: bool) -> Pack:
    return prompts_of(DomainFile.model_validate_json(domain), shifts=shifts)


class TextGame:
    """One episode, which waits for the answers of a model.

    Attributes:
        request: Conversation that the model continues next; None after the end.
        player: Player for whom the model is asked; the first one if it is asked for all.

    Raises:
        RobotouilleError: The agent cannot play with this control.
    """

    def __init__(self, instance: GameInstance, options: GameOptions | None = None) -> None:
        self.instance = instance
        self.options = options or GameOptions()
        self.world = World(instance.task)
        self.player = self.world.players[0]
        self.request: ModelRequest | None = None
        self._budget = instance.budget
        self._runners: list[RecordedRunner] = []
        self._answers = 0
        self._ended: EndReason | None = None
        self._rewarded = 0.0
        self._progress = self._new_progress() if self.options.dense else None
        self._playing: Coroutine[_Question, Completion | None, EndReason] = self._episode()
        self._go_on(None)

    @property
    def state(self) -> State:
        """Current state."""
        return self._runners[-1].state if self._runners else self.world.initial

    @property
    def legal(self) -> tuple[str, ...]:
        """Possible actions for the current request; with the control `joint`, `ROBOT: ACTION`."""
        return valid_actions(self.request) if self.request is not None else ()

    @property
    def text(self) -> str:
        """Last message of the current request: the observation, or empty after the end."""
        return self.request.messages[-1].content if self.request is not None else ""

    @property
    def feedback(self) -> str:
        """Reason why the last answer was rejected, or empty."""
        line = self.text.partition("\n")[0]
        return line.removeprefix(FEEDBACK) if line.startswith(FEEDBACK) else ""

    def headed(self, text: str) -> str:
        """Return an answer that is only a possible action with its heading; others unchanged."""
        alone = text.strip()
        # Comparing a long text with each action would take time.
        if "\n" in alone or len(alone) > MAX_ALONE:
            return text
        action = TolerantParser().match(alone, self.legal)
        if action is None:
            return text
        return f"Actions:\n{action}" if self.options.control == "joint" else f"Action: {action}"

    def answer(self, text: str) -> float:
        """Continue with the model's answer, and return the reward.

        Raises:
            WrongArgumentError: The game is over.
        """
        if self.request is None:
            raise WrongArgumentError("the game is over; begin a new one")
        self._answers += 1
        self._go_on(Completion(cut_answer(encodable(text))))
        return self._reward()

    @property
    def score(self) -> GameScore:
        """Score so far."""
        runner = self._runners[-1] if self._runners else None
        shift, orders = self.instance.task.problem.shift, self.state.orders
        points = orders.score if shift is not None and orders is not None else None
        most = shift.planner.get(self.instance.task.seats) if shift is not None else None
        return GameScore(
            ended=self._ended,
            success=self._ended is EndReason.GOAL,
            steps=runner.steps if runner is not None else 0,
            budget=self._budget.max_steps,
            optimum=self.instance.optimum,
            progress=self._progress_value(),
            points=points,
            share=points / most if points is not None and most and most > 0 else None,
            answers=self._answers,
            invalid=sum(each.invalid for each in self._runners),
            malformed=sum(each.malformed for each in self._runners),
        )

    def recording(self) -> bytes:
        """Return the recording of the last trial. It ends the game.

        Raises:
            WrongArgumentError: The game has not begun, because no trial was played.
        """
        self.close()
        if not self._runners:
            raise WrongArgumentError("the game has no recording")
        return self._runners[-1].recording()

    def close(self) -> None:
        """End the game if it is not over."""
        self.request = None
        self._playing.close()

    def _progress_value(self) -> float | None:
        if self.world.shift is not None:
            return None
        if self._progress is not None:
            return self._progress.value
        return float(self._ended is EndReason.GOAL)

    def _new_progress(self) -> Progress | None:
        known = self.instance.known
        if known is None:
            return None
        return Progress(self.world, self.instance.plan(self.world), known.bound)

    def _reward(self) -> float:
        if self._progress is not None:
            self._progress.move(self.state)
        total = self.score.reward
        gain, self._rewarded = total - self._rewarded, total
        return gain

    def _go_on(self, completion: Completion | None) -> None:
        """Play until the next question or the end."""
        try:
            question = self._playing.send(completion)
        except StopIteration as stop:
            self.request = None
            self._ended = stop.value
            self._finish_shift()
        else:
            self.player, self.request = question

    def _finish_shift(self) -> None:
        """Let the rest of a shift pass, so that orders expire after a model has given up."""
        if self.world.shift is None or not self._runners:
            return
        runner = self._runners[-1]
        while not runner.state.shift_over and runner.steps < self._budget.max_steps:
            runner.step({})

    async def _episode(self) -> EndReason:
        players, budget = self.world.players, self._budget.steps
        if len(players) == 1:
            strategy = make_strategy(self._pack, self.options.agent, self.instance.dataset)
            alone = TextEpisode(
                self.world, strategy, budget, begin=self._begin, view=State.text_view
            )
            return (await answer_all(alone.play(), self._completes[players[0]])).ended
        runner = self._begin(math.ceil(budget))
        return (await play_team(self._team(), runner, budget)).ended

    def _begin(self, limit: int) -> EpisodeRunner:
        players = self.world.players
        runner = RecordedRunner(
            self.world,
            dict.fromkeys(players, self.options.agent),
            episode_rules(len(players), limit),
            kind="model",
            episode=self.instance.name,
        )
        self._runners.append(runner)
        return runner

    def _team(self) -> Team:
        agent, control, pack = self.options.agent, self.options.control, self._pack
        dataset, players = self.instance.dataset, self.world.players
        if self.options.partner:
            seats: dict[str, Strategy] = {p: planner(self.world, p, seed=0) for p in players}
            seats[players[0]] = make_strategy(pack, agent, dataset)
            return IndependentTeam(seats, self._completes, in_turn=True)
        if control == "each":
            seats = {player: make_strategy(pack, agent, dataset) for player in players}
            return IndependentTeam(seats, self._completes, in_turn=True)
        strategy = team_strategy(pack, agent, dataset, control)
        kind = JointTeam if control == "joint" else TurnsTeam
        return kind(strategy, self._completes[players[0]])

    @property
    def _pack(self) -> Pack:
        domain = self.instance.task.domain
        text = domain.model_dump_json(by_alias=True, exclude_unset=True)
        return _prompts(text, self.world.shift is not None)

    @property
    def _completes(self) -> Mapping[str, Complete]:
        def complete_for(player: str) -> Complete:
            async def complete(request: ModelRequest) -> Completion:
                return await _Asked(_Question(player, request))

            return complete

        return {player: complete_for(player) for player in self.world.players}
