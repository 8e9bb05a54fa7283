"""Bots that play next to a person in a local game, in this process or a separate one.

A search in a thread would hold the interpreter's lock and delay frames. The window therefore uses
a process, which answers requests:

| request | reply |
| --- | --- |
| `["begin", task as JSON, [kind, seed, skill, words as JSON], players, step seconds]` | none |
| `["meet", kinds, clock]`, `["hear", player, speech]`, `["observe", moves]` | `say` |
| `["ask", player, state]` | `say`; `["act", player, [name, …arguments], waits]` |

A bot that does nothing answers with nil in place of the action. `["say", player, [text, signal,
to_bots]]` reports what a bot says. It is sent only while no other request waits. A signal is nil or
`[intent, target]`.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from threading import Thread
from typing import Any, NamedTuple, Protocol

from robotouille.domain.rendering import NO_WORDS, Language
from robotouille.domain.task import Task
from robotouille.planning.bot_process import (
    CHUNK,
    packed,
    read_moves,
    read_state,
    serve_requests,
    state_row,
    unpacker,
)
from robotouille.planning.policies.policy import Did, Policy, Speech, TeamPolicy, waits
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.signals import signal_from
from robotouille.world.world import State, World
from robotouille_client.bots.kinds import BotKind, BotSetup, bot_maker


class Decision(NamedTuple):
    """A bot's decision: an action, or None to do nothing.

    `waits` declares that doing nothing means waiting for a place or a teammate.
    """

    player: str
    action: GroundAction | None
    waits: bool = False


class Partners(Protocol):
    """The bots of all seats that no person plays.

    Decisions may take time, so they are requested with `ask` and collected with `answers`.
    """

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        """Inform the bots of the clock and of who controls each player."""

    def observe(self, did: Did) -> None:
        """Report the actions of a step. Called once for each step, before `ask`."""

    def hear(self, player: str, speech: Speech) -> None:
        """Pass on a chat message or a signal of a player."""

    def ask(self, player: str, state: State) -> None:
        """Request a decision of a player's bot, which must have answered the last request."""

    def answers(self) -> list[Decision]:
        """Return the decisions since the last call."""

    def spoken(self) -> list[tuple[str, Speech]]:
        """Return what the players have said since the last call.

        Other bots have already heard the texts that are only for bots.
        """

    def news(self) -> list[str]:
        """Return messages about failed or restarted bots since the last call, for people."""

    def close(self) -> None:
        """Stop the bots."""


MakePartners = Callable[[State, BotSetup, Sequence[str], float], Partners]
"""Makes bots from the initial state, their setup, their players and the seconds of a step."""


class PromptPartners:
    """Bots that decide at once in the calling thread, so that a game can be repeated exactly."""

    def __init__(self, policies: Mapping[str, Policy]) -> None:
        self._policies = policies
        self._team = {p: each for p, each in policies.items() if isinstance(each, TeamPolicy)}
        self._answers: list[Decision] = []

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        for policy in self._team.values():
            policy.meet(kinds, clock)

    def observe(self, did: Did) -> None:
        for policy in self._policies.values():
            policy.observe(did)

    def hear(self, player: str, speech: Speech) -> None:
        for policy in self._team.values():
            policy.hear(player, speech)

    def ask(self, player: str, state: State) -> None:
        policy = self._policies[player]
        action = policy.act(state)
        self._answers.append(Decision(player, action, action is None and waits(policy)))

    def answers(self) -> list[Decision]:
        found, self._answers = self._answers, []
        return found

    def spoken(self) -> list[tuple[str, Speech]]:
        said = [(player, speech) for player, each in self._team.items() for speech in each.speak()]
        for player, speech in said:
            if speech.to_bots:
                self.hear(player, speech)
        return said

    def news(self) -> list[str]:
        return []

    def close(self) -> None:
        pass


def prompt_partners(
    start: State, setup: BotSetup, players: Sequence[str], step_seconds: float = 0.0
) -> PromptPartners:
    """Make bots that decide in the calling thread."""
    make = bot_maker(setup, step_seconds=step_seconds)
    return PromptPartners({player: make(start, player) for player in players})


COMMAND = (sys.executable, "-P", "-m", "robotouille_client.bots.partners")
PLAIN = {"ROBOTOUILLE_COMPILE": "0"}
"""Default environment: plan without compiled code. Compiling takes half a minute and would start
in the middle of a game, with the first plan that involves the person."""
LIVES = 2
"""Maximum number of processes per game, one after the other."""

RESTARTED = "The bots' process ended. The bots plan again in a new process."
GONE = "The bots' process ended again. The game continues without the bots."


class PartnerProcess:
    """Bots of some players in a process that runs until `close`.

    If the process dies, it is replaced once. If the replacement dies, too, the bots do nothing and
    the game continues without them.
    """

    def __init__(
        self, start: State, setup: BotSetup, players: Sequence[str], step_seconds: float = 0.0
    ) -> None:
        self._world: World = start.world
        self._task = json.dumps(start.world.task.to_json())
        words = (setup.words or NO_WORDS).model_dump_json(exclude_unset=True)
        chosen = setup.kind.value, setup.seed, setup.skill, words
        self._begin = chosen, list(players), step_seconds
        self._met: tuple[dict[str, str], str] | None = None
        self._asked: dict[str, tuple[Any, ...]] = {}
        self._replies: deque[Any] = deque()
        self._spoken: list[tuple[str, Speech]] = []
        self._news: list[str] = []
        self._closed = False
        self._lives = LIVES
        self._start()

    def _start(self) -> None:
        self._process = subprocess.Popen(  # noqa: S603
            COMMAND,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            env={**PLAIN, **os.environ},
        )
        self._reader = Thread(target=self._read, args=(self._process,), daemon=True)
        self._reader.start()
        self._send("begin", self._task, *self._begin)
        if self._met is not None:
            self._send("meet", *self._met)
        for question in self._asked.values():
            self._send(*question)

    def _restart(self) -> None:
        """Replace a dead process. The new one gets all open questions."""
        self._end()
        self._lives -= 1
        if self._lives:
            self._news.append(RESTARTED)
            self._start()
        else:
            self._news.append(GONE)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        self._met = dict(kinds), clock
        self._send("meet", *self._met)

    def observe(self, did: Did) -> None:
        moves = [(player, a.name, a.arguments, applied) for player, a, applied in did]
        self._send("observe", moves)

    def hear(self, player: str, speech: Speech) -> None:
        self._send("hear", player, speech)

    def ask(self, player: str, state: State) -> None:
        row = state_row(state)
        self._asked[player] = "ask", player, row
        self._send(*self._asked[player])

    def answers(self) -> list[Decision]:
        ended = self._lives and not (self._reader.is_alive() or self._closed)
        found: list[Decision] = []
        while self._replies:
            what, player, told, *more = self._replies.popleft()
            if what == "say":
                self._spoken.append((player, _speech(*told)))
            elif self._asked.pop(player, None) is not None:
                action = None if told is None else self._action(*told)
                found.append(Decision(player, action, *more))
        if ended:
            self._restart()
        if not self._lives:
            found += [Decision(player, None) for player in self._asked]
            self._asked.clear()
        return found

    def news(self) -> list[str]:
        found, self._news = self._news, []
        return found

    def spoken(self) -> list[tuple[str, Speech]]:
        said, self._spoken = self._spoken, []
        return said

    def close(self) -> None:
        """End the process at once, even during a search."""
        if self._closed:
            return
        self._closed = True
        self._end()

    def _end(self) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join()
        with contextlib.suppress(OSError):
            self._input.close()

    def _action(self, name: str, *arguments: str) -> GroundAction:
        self._world.admit(arguments)
        return self._world.action(name, *arguments)

    @property
    def _input(self) -> Any:
        return self._process.stdin

    def _send(self, *request: Any) -> None:
        # `answers` handles a process that has died.
        if self._lives and not self._closed:
            with contextlib.suppress(BrokenPipeError):
                self._input.write(packed(*request))

    def _read(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None  # noqa: S101
        stream = unpacker()
        with process.stdout as output:
            while data := os.read(output.fileno(), CHUNK):
                stream.feed(data)
                self._replies.extend(stream)


def replies(
    requests: Iterator[Any], is_last: Callable[[], bool] = lambda: True
) -> Iterator[tuple[Any, ...]]:
    """Yield what the bots say and decide. The first request must be `begin`.

    Args:
        requests: The requests of the window.
        is_last: Returns True if no other request waits. Chat messages are held back until then,
            so that they match the state that the player sees.
    """
    _, task, (kind, seed, skill, words), players, step_seconds = next(requests)
    world = World(Task.from_json(json.loads(task)))
    language = Language.model_validate_json(words)
    setup = BotSetup(BotKind(kind), seed, skill, words=language)
    partners = prompt_partners(world.initial, setup, players, step_seconds)
    for what, *about in requests:
        _apply(partners, world, what, *about)
        if is_last():
            yield from (("say", player, speech) for player, speech in partners.spoken())
        for player, action, waiting in partners.answers():
            did = None if action is None else (action.name, *action.arguments)
            yield "act", player, did, waiting


def _speech(text: str, signal: tuple[str, str] | None, to_bots: bool) -> Speech:
    return Speech(text, None if signal is None else signal_from(*signal), to_bots)


def _apply(partners: PromptPartners, world: World, what: str, *about: Any) -> None:
    if what == "meet":
        partners.meet(*about)
    elif what == "hear":
        player, speech = about
        partners.hear(player, _speech(*speech))
    elif what == "observe":
        partners.observe(read_moves(world, *about))
    else:
        player, state = about
        partners.ask(player, read_state(world, state))


def main() -> None:
    """Run the process of the bot partners."""
    serve_requests(replies)


if __name__ == "__main__":
    main()
