"""Inspect transcript of an episode while it is played."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping

from inspect_ai.log import transcript
from inspect_ai.model import ChatMessage

from robotouille import State
from robotouille.errors import MissingExtraError
from robotouille_client.window import require_pygame
from robotouille_evaluation.agents.proposal import Exchange
from robotouille_evaluation.models.inspect_provider import as_chat
from robotouille_evaluation.models.model import Message
from robotouille_evaluation.runs.episode_runner import (
    ChosenAction,
    EpisodeRunner,
    RecordedRunner,
    RunnerStep,
)

SIZE = (640, 244)
"""Pixels of the drawing before it is cropped. Inspect's viewer folds higher pictures."""
FRAME = 12
SOURCE = "kitchen"


class Pictures:
    """Painter of an episode's states.

    JPEG takes about 12 kB and a millisecond. PNG would take tens of milliseconds, in which all
    other episodes of the process would wait.

    Raises:
        MissingExtraError: pygame is not installed.
    """

    def __init__(self) -> None:
        require_pygame("a picture of a state")
        import pygame

        from robotouille_client.window.drawing.painter import Painter

        self._painter = Painter()
        self._surface = pygame.Surface(SIZE)

    def data_uri(self, state: State) -> str:
        """Return a picture of a state as `data:image/jpeg;base64,…`."""
        import pygame

        from robotouille_client.window.view import View

        self._painter.paint(self._surface, View(state.world, state))
        # Panels around the kitchen repeat what the transcript says in words.
        kitchen = self._painter.layout(SIZE, state.world).kitchen.inflate(FRAME, FRAME)
        shown = self._surface.subsurface(kitchen.clip(self._surface.get_rect()))
        file = io.BytesIO()
        pygame.image.save(shown, file, "state.jpg")
        return f"data:image/jpeg;base64,{base64.b64encode(file.getvalue()).decode()}"


class TranscriptWriter:
    """Writes trials, states with pictures, and rejected answers of one episode to a transcript.

    Models receive nothing of it. Inspect itself writes the model calls.

    Args:
        pictures: Draw states. Without pygame a message replaces the pictures.
    """

    def __init__(self, *, pictures: bool) -> None:
        self.exchanges: list[tuple[str, Exchange]] = []
        self.runners: list[RecordedRunner] = []
        """Runners of all trials."""
        self._pictures = _pictures() if pictures else None

    def wrap(self, runner: RecordedRunner) -> EpisodeRunner:
        """Return a runner that writes what happens to the transcript."""
        self.runners.append(runner)
        self.show(runner.state, f"Trial {len(self.runners)}")
        return _WrittenRunner(runner, self)

    def show(self, state: State, caption: str) -> None:
        """Write a state with a caption in Markdown."""
        if self._pictures is not None:
            caption = f"![{caption}]({self._pictures.data_uri(state)}) {caption}"
        transcript().info(caption, source=SOURCE)

    def answered(self, player: str, exchange: Exchange) -> None:
        """Keep an exchange, and write it if the answer was rejected."""
        self.exchanges.append((player, exchange))
        if exchange.verdict.rejected:
            why = {
                "player": player,
                "rejected": exchange.verdict.value,
                "feedback": exchange.feedback,
            }
            transcript().info(dict(why), source=SOURCE)

    def messages(self) -> list[ChatMessage]:
        """Return the episode as one conversation.

        Requests repeat earlier messages, so only the first request of a player is included whole.
        """
        conversation: list[tuple[str, Message]] = []
        for player, exchange in self.exchanges:
            if exchange.completion is not None:
                asked = exchange.request.messages
                new = asked[-1:] if any(who == player for who, _ in conversation) else asked
                answer = Message("assistant", exchange.completion.text)
                conversation += [(player, message) for message in (*new, answer)]
        chat = as_chat(tuple(message for _, message in conversation))
        return [
            message.model_copy(update={"metadata": {"player": player}})
            for (player, _), message in zip(conversation, chat, strict=True)
        ]


class _WrittenRunner:
    """Runner whose steps and answers are written to a transcript."""

    def __init__(self, runner: EpisodeRunner, writer: TranscriptWriter) -> None:
        self._runner = runner
        self._writer = writer
        self._steps = 0

    @property
    def state(self) -> State:
        """Current state."""
        return self._runner.state

    def step(self, choices: Mapping[str, ChosenAction]) -> RunnerStep:
        """Take a step and write its result."""
        step = self._runner.step(choices)
        self._steps += 1
        self._writer.show(step.state, _step_text(self._steps, step))
        return step

    def answered(self, player: str, exchange: Exchange) -> None:
        """Pass an answer on and write it."""
        self._runner.answered(player, exchange)
        self._writer.answered(player, exchange)

    def reject(self, player: str, choice: ChosenAction, state: State | None = None) -> None:
        """Pass a rejected choice on."""
        self._runner.reject(player, choice, state)

    def say(self, player: str, text: str) -> None:
        """Pass a chat message on."""
        self._runner.say(player, text)


def _step_text(number: int, step: RunnerStep) -> str:
    """Return who did what. All words come from the task and none from a model."""
    did = [
        f"{action.sentence if action is not None else f'{player} does nothing'}"
        f"{'' if applied else ' (no effect)'}"
        for player, action, applied in step.did
    ]
    goal = "; the goal is reached" if step.state.goal_reached else ""
    return f"Step {number}: {'; '.join(did)}{goal}."


def _pictures() -> Pictures | None:
    try:
        return Pictures()
    except MissingExtraError as missing:
        transcript().info(f"There are no pictures: {missing}", source=SOURCE)
        return None
