"""What is told of an episode in Inspect's transcript, while it is played."""

from __future__ import annotations

from collections.abc import Mapping

from inspect_ai.log import transcript
from inspect_ai.model import ChatMessage

from robotouille import State
from robotouille.errors import MissingExtraError
from robotouille_evaluation.agents.proposal import Exchange
from robotouille_evaluation.inspect_tasks.pictures import Pictures
from robotouille_evaluation.models.inspect_provider import as_chat
from robotouille_evaluation.models.model import Message
from robotouille_evaluation.runs.stage import Decision, Moved, RecordedStage, Stage

__all__ = ["EpisodeTelling"]

SOURCE = "kitchen"


class EpisodeTelling:
    """Tells of one episode: each state with a picture, each refused answer, the trials.

    The models are sent nothing of it. Calls of models Inspect tells by itself.

    Args:
        pictures: Whether there are any; without pygame there are none, and that is told.
    """

    def __init__(self, *, pictures: bool) -> None:
        self.exchanges: list[tuple[str, Exchange]] = []
        self.stages: list[RecordedStage] = []
        """Of all trials."""
        self._pictures = _pictures() if pictures else None

    def watch(self, stage: RecordedStage) -> Stage:
        """A stage of which is told what happens on it: a `Watch`."""
        self.stages.append(stage)
        self.show(stage.state, f"Trial {len(self.stages)}")
        return _ToldStage(stage, self)

    def show(self, state: State, what: str) -> None:
        """Tell of a state, in Markdown."""
        if self._pictures is not None:
            what = f"![{what}]({self._pictures.data_uri(state)}) {what}"
        transcript().info(what, source=SOURCE)

    def answered(self, player: str, exchange: Exchange) -> None:
        """Tell of an answer, if it was refused."""
        self.exchanges.append((player, exchange))
        if exchange.verdict.rejected:
            why = {
                "player": player,
                "refused": exchange.verdict.value,
                "feedback": exchange.feedback,
            }
            transcript().info(dict(why), source=SOURCE)

    def messages(self) -> list[ChatMessage]:
        """The episode as one conversation: what was said first, then what was new each time."""
        said: list[tuple[str, Message]] = []
        for player, exchange in self.exchanges:
            if exchange.completion is not None:
                asked = exchange.request.messages
                new = asked[-1:] if any(who == player for who, _ in said) else asked
                answer = Message("assistant", exchange.completion.text)
                said += [(player, message) for message in (*new, answer)]
        chat = as_chat(tuple(message for _, message in said))
        return [
            message.model_copy(update={"metadata": {"player": player}})
            for (player, _), message in zip(said, chat, strict=True)
        ]


class _ToldStage:
    """A stage of which is told."""

    def __init__(self, stage: Stage, telling: EpisodeTelling) -> None:
        self._stage = stage
        self._telling = telling
        self._steps = 0

    @property
    def state(self) -> State:
        """As it is now."""
        return self._stage.state

    def step(self, decisions: Mapping[str, Decision]) -> Moved:
        """Take a step, and show what came of it."""
        moved = self._stage.step(decisions)
        self._steps += 1
        self._telling.show(moved.state, _step_text(self._steps, moved))
        return moved

    def answered(self, player: str, exchange: Exchange) -> None:
        """Pass it on, and tell of it."""
        self._stage.answered(player, exchange)
        self._telling.answered(player, exchange)

    def refuse(self, player: str, decision: Decision, state: State | None = None) -> None:
        """Pass it on."""
        self._stage.refuse(player, decision, state)

    def say(self, player: str, text: str) -> None:
        """Pass it on."""
        self._stage.say(player, text)


def _step_text(step: int, moved: Moved) -> str:
    """Who did what; the names in it are those of the task, and no model's words."""
    did = [
        f"{action.sentence if action is not None else f'{player} does nothing'}"
        f"{'' if applied else ' (no effect)'}"
        for player, action, applied in moved.did
    ]
    goal = "; the goal is reached" if moved.state.goal_reached else ""
    return f"Step {step}: {'; '.join(did)}{goal}."


def _pictures() -> Pictures | None:
    try:
        return Pictures()
    except MissingExtraError as missing:
        transcript().info(f"There are no pictures: {missing}", source=SOURCE)
        return None
