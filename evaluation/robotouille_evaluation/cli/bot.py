"""`robotouille-bot llm`: a language model that plays on a server."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path
from typing import Any

from robotouille.errors import RobotouilleError
from robotouille.protocol.messages import Kind, View
from robotouille.terminal import printable, tell
from robotouille_client import Game
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_client.bots.llm_options import LlmBotOptions
from robotouille_evaluation.agents.joint_team import JointTeam
from robotouille_evaluation.agents.making import (
    PAPER_REACT,
    default_strategy,
    make_strategy,
    team_strategy,
)
from robotouille_evaluation.agents.network import NetworkAgent
from robotouille_evaluation.agents.proposal import Complete, ContextOverflow, Exchange, exchange_row
from robotouille_evaluation.agents.team import Control, IndependentTeam, TurnsTeam
from robotouille_evaluation.cli.models import FATAL, ModelChoice, open_model
from robotouille_evaluation.models import (
    Completion,
    Model,
    ModelError,
    ModelErrorKind,
    ModelRequest,
)
from robotouille_evaluation.packs.built_in import find_pack
from robotouille_evaluation.packs.own import NAME
from robotouille_evaluation.realtime import Charge, LatePolicy
from robotouille_evaluation.realtime.network import RealTimeAgent, RealTimeOptions
from robotouille_evaluation.runs.journal import append_line


@dataclass(frozen=True, slots=True)
class LanguageModelBot:
    """Language model that plays a game on a server.

    The game is joined with both views: the model reads the text, and a helper plans on states.

    Args:
        strategy: Name of a built-in strategy, or an experiment of the pack.
        transcript: File of JSON lines with the exchanges.
        options: Options for worlds that do not wait.
        control: How the model controls several seats.
        pack: Built-in pack or folder of a pack with prompts, examples and experiments.
    """

    model: ModelChoice
    strategy: str = PAPER_REACT
    transcript: Path | None = None
    seed: int = 0
    options: RealTimeOptions = field(default_factory=RealTimeOptions)
    control: Control = "each"
    pack: str = NAME
    kind: Kind = "model"
    view: View = "both"

    @classmethod
    def of(
        cls, options: LlmBotOptions, *, seed: int = 0, control: Control = "each"
    ) -> LanguageModelBot:
        """Return the bot of command-line options, or raise WrongArgumentError."""
        helper = options.helper
        maker = policy_maker(BotKind(helper), seed) if helper != "none" else None
        real_time = RealTimeOptions(
            LatePolicy(options.late),
            options.digest_tokens,
            maker,
            Charge.parse(options.charge),
            options.max_age,
        )
        choice = ModelChoice.of_options(options)
        strategy = options.strategy or default_strategy(control)
        return cls(choice, strategy, options.transcript, seed, real_time, control, options.pack)

    @property
    def partial(self) -> bool:
        """True if the bot can play with a part of the state: helpers plan on all of it."""
        return self.options.helper is None

    @property
    def agent(self) -> str:
        """The model, its parameters and the strategy, for recordings."""
        settings = {**self.model.parameters, "strategy": self.strategy, "seed": self.seed}
        if self.pack != NAME:
            settings["pack"] = Path(self.pack).name
        words = (f"{name}={value}" for name, value in settings.items())
        return " ".join((self.model.name, *words))[:200]

    @asynccontextmanager
    async def opened(self) -> AsyncIterator[Callable[[Game], Awaitable[Mapping[str, Any]]]]:
        """Open model and transcript, and yield a function that plays a game to its end.

        Raises:
            UnknownNameError: The strategy or the pack is unknown.
            FileError: The folder of the pack has no valid pack.
            RobotouilleError: The strategy does not support several seats, or the transcript cannot
                be written.
            ModelError: The key is missing or the provider is unknown; in a game, the model cannot
                be asked at all.
        """
        pack, dataset = find_pack(self.pack), "asynchronous"
        strategy = make_strategy(pack, self.strategy, dataset)
        if self.control != "each":
            strategy = team_strategy(pack, self.strategy, dataset, self.control)
        async with AsyncExitStack() as opened:
            model = await open_model(self.model, self.seed, opened)
            complete = _patiently(model)
            record = opened.enter_context(_transcript(self.transcript))

            async def play(game: Game) -> Mapping[str, Any]:
                while not (game.has_state or game.ended):
                    await game.next_event()
                if self.control != "each":
                    make = JointTeam if self.control == "joint" else TurnsTeam
                    return await NetworkAgent(game, make(strategy, complete), record).play()
                if game.clock.get("clock") == "realtime":
                    moving = RealTimeAgent(game, strategy, complete, self.options, record)
                    return await moving.play()
                seat = game.own_seats[0]
                alone = IndependentTeam({seat: strategy}, {seat: complete})
                return await NetworkAgent(game, alone, record).play()

            yield play


def _patiently(model: Model) -> Complete:
    """Return a function that answers with an empty text if the model fails for a moment.

    The game goes on without the model then, so the bot must not stop.
    """

    async def complete(request: ModelRequest) -> Completion:
        try:
            return await model.complete(request)
        except ModelError as error:
            if error.kind is ModelErrorKind.CONTEXT_OVERFLOW:
                raise ContextOverflow from None
            if error.kind in FATAL:
                raise
            tell(printable(f"{model.name}: {error}"), err=True)
            return Completion(
                "", error.usage, finish_reason=error.kind.value, attempts=error.attempts
            )

    return complete


@contextmanager
def _transcript(path: Path | None) -> Iterator[Any]:
    if path is None:
        yield lambda _: None
        return
    try:
        file = FileIO(path, "ab")
    except OSError as error:
        raise RobotouilleError(f"{path}: cannot be written: {error.strerror}") from None
    with file:
        yield lambda exchange: _write(file, path, exchange)


def _write(file: FileIO, path: Path, exchange: Exchange) -> None:
    """Append a line. If the disk is full, the game goes on without it."""
    line = json.dumps(exchange_row(exchange), ensure_ascii=False) + "\n"
    try:
        append_line(file, line.encode())
    except OSError as error:
        tell(printable(f"{path}: not written: {error.strerror}"), err=True)
