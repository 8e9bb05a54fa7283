"""`robotouille-bot llm`: a language model takes a seat."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path
from typing import Any

from robotouille.errors import RobotouilleError
from robotouille.program import printable, tell
from robotouille.protocol.messages import Kind, View
from robotouille_client import Game
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_evaluation.agents.asking import Complete
from robotouille_evaluation.agents.exchange_rows import exchange_row
from robotouille_evaluation.agents.making import make_strategy, team_strategy
from robotouille_evaluation.agents.network import NetworkAgent
from robotouille_evaluation.agents.proposal import ContextOverflow, Exchange
from robotouille_evaluation.agents.teams.joint import Joint
from robotouille_evaluation.agents.teams.team import Control, Each, Turns
from robotouille_evaluation.cli.models import FATAL, ModelChoice, open_model
from robotouille_evaluation.models import (
    Completion,
    Model,
    ModelError,
    ModelErrorKind,
    ModelRequest,
)
from robotouille_evaluation.packs.own import build_own_pack
from robotouille_evaluation.realtime import Charge, Late
from robotouille_evaluation.realtime.network import RealTimeAgent, RealTimeOptions
from robotouille_evaluation.runs.appending import append_line

__all__ = ["LanguageModelBot"]


@dataclass(frozen=True, slots=True)
class LanguageModelBot:
    """Plays a game that is joined in both views: it reads the text, and a helper plans on states.

    Args:
        model: Which, and how it is asked.
        strategy: One of ours.
        transcript: A file of JSON lines with what the model was sent and has said.
        options: How it plays where the world does not wait.
        control: How it is asked where it plays several seats.
    """

    model: ModelChoice
    strategy: str = "react-last-reasoning-action"
    transcript: Path | None = None
    seed: int = 0
    options: RealTimeOptions = field(default_factory=RealTimeOptions)
    control: Control = "each"
    kind: Kind = "model"
    view: View = "both"

    @classmethod
    def of(
        cls,
        model: str,
        *,
        base_url: str,
        strategy: str,
        transcript: Path | None,
        seed: int,
        temperature: float | None,
        prices: str,
        timeout: float | None,
        attempts: int | None,
        late: str = Late.APPLY,
        helper: str = "none",
        digest_tokens: int = 0,
        charge: str = "wall",
        control: Control = "each",
    ) -> LanguageModelBot:
        """From the options of a command line; WrongArgumentError where they cannot be."""
        parameters = {} if temperature is None else {"temperature": temperature}
        choice = ModelChoice(model, base_url, parameters, prices, timeout, attempts)
        maker = policy_maker(BotKind(helper), seed) if helper != "none" else None
        options = RealTimeOptions(Late(late), digest_tokens, maker, Charge.parse(charge))
        return cls(choice, strategy, transcript, seed, options, control)

    @asynccontextmanager
    async def opened(self) -> AsyncIterator[Callable[[Game], Awaitable[Mapping[str, Any]]]]:
        """What plays a game to its end, once the model and all else that it takes are there.

        Raises:
            UnknownNameError: There is no such strategy.
            RobotouilleError: It cannot play several seats, but is to.
            ModelError: There is no key or no such provider; in a game, that nobody answers at all.
            RobotouilleError: The transcript cannot be written.
        """
        pack, dataset = build_own_pack(), "asynchronous"
        strategy = make_strategy(pack, self.strategy, dataset)
        if self.control != "each":
            strategy = team_strategy(pack, self.strategy, dataset, self.control)
        async with AsyncExitStack() as opened:
            model = await open_model(self.model, self.seed, opened)
            complete = _patiently(model)
            told = opened.enter_context(_transcript(self.transcript))

            async def play(game: Game) -> Mapping[str, Any]:
                while not (game.has_state or game.ended):
                    await game.next_event()
                if self.control != "each":
                    make = Joint if self.control == "joint" else Turns
                    return await NetworkAgent(game, make(strategy, complete), told).play()
                if game.clock.get("clock") == "realtime":
                    moving = RealTimeAgent(game, strategy, complete, self.options, told)
                    return await moving.play()
                seat = game.own_seats[0]
                alone = Each({seat: strategy}, {seat: complete})
                return await NetworkAgent(game, alone, told).play()

            yield play


def _patiently(model: Model) -> Complete:
    """A model that fails for a moment says nothing in it: the game goes on."""

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
    """A line; where the disk is full, the game goes on without."""
    line = json.dumps(exchange_row(exchange), ensure_ascii=False) + "\n"
    try:
        append_line(file, line.encode())
    except OSError as error:
        tell(printable(f"{path}: not written: {error.strerror}"), err=True)
