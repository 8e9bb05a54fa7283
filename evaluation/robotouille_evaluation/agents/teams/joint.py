"""One model for all seats, asked once a step: its answer has a line for each.

Reasoning: robot1 cooks, robot2 cuts meanwhile.
Actions:
robot1: Move robot1 from table1 to stove1
robot2: wait
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice

from robotouille.planning.policies import Did
from robotouille_evaluation.agents.answers import ParsedAnswer, Tolerant
from robotouille_evaluation.agents.asking import Complete, answer_all
from robotouille_evaluation.agents.proposal import (
    Exchange,
    ExchangeVerdict,
    Observation,
    Proposal,
    Strategy,
)
from robotouille_evaluation.agents.teams.team import Refusals, Take

__all__ = ["Joint", "JointAnswers", "joint_observation"]

WAIT = "wait"
MAX_LINES = 32
"""Lines of actions that are read of an answer, the last ones; games have 16 seats at most."""
MAX_NAMED = 8
"""Lines that are named to a model as not valid; it will see by these what is wrong."""


class JointAnswers(Tolerant):
    """Answers with a line for each robot; valid actions are such lines, too. The last line of a
    robot counts. One that is left out, or waits, does nothing."""

    no_action = (
        "The actions were malformed. Please provide 'Actions:' and below it a line for each robot, "
        "in the form '<robot>: <action>'."
    )
    _END = re.compile(Tolerant._BEFORE + r"Actions?\b", re.MULTILINE | re.IGNORECASE)
    _HEADING = re.compile(
        Tolerant._BEFORE + r"Action(s?)[ \t]?\d{0,3}[*_]{0,3}[ \t]?:[*_]{0,3}\s*(.*)",
        re.IGNORECASE,
    )

    def step(self, text: str) -> ParsedAnswer:
        """The lines behind the last `Actions:`."""
        lines: list[str] | None = None
        for line in text.splitlines():
            heading = self._HEADING.match(line)
            if heading and (heading[1] or lines is None):
                lines = []
            said = self._trim(heading[2] if heading else line)
            if lines is not None and said:
                lines.append(said)
        action = "\n".join(lines[-MAX_LINES:]) if lines else None
        return ParsedAnswer(self._reasoning(text), action)

    def match(self, action: str, valid: tuple[str, ...]) -> str | None:
        """The lines as they are among the valid ones; None if one of them is not."""
        chosen = self._chosen(action, valid)
        if None in chosen.values():
            return None
        return "\n".join(line for line in chosen.values() if line)

    def invalid(self, action: str, valid: tuple[str, ...]) -> str:
        """Names every robot whose action is not valid."""
        refused = [
            f"'{line}' is no line of a robot" if not sentence else
            f"The action '{sentence}' of {player} is not valid"
            for line, player, sentence in islice(self._refused(action, valid), MAX_NAMED)
        ]  # fmt: skip
        return f"{'. '.join(refused)}. Nobody has acted. Please answer again, for all robots."

    def refused(self, action: str, valid: tuple[str, ...]) -> tuple[str, str]:
        """The robot and the sentence of the first line that is not valid."""
        _, player, sentence = next(self._refused(action, valid))
        return player, sentence

    def _refused(self, action: str, valid: tuple[str, ...]) -> Iterator[tuple[str, str, str]]:
        for line, found in self._chosen(action, valid).items():
            if found is None:
                player, _, sentence = line.partition(":")
                yield line, self._trim(player), sentence.strip()

    def _chosen(self, action: str, valid: tuple[str, ...]) -> dict[str, str | None]:
        """The last line of each robot, with the valid one that is meant: empty where it waits,
        None where there is none."""
        last: dict[str, str] = {}
        for line in action.split("\n"):
            last[self._plain(self._trim(line.partition(":")[0]))] = line
        return {line: self._meant(line, valid) for line in last.values()}

    def _meant(self, line: str, valid: tuple[str, ...]) -> str | None:
        player, colon, sentence = line.partition(":")
        if colon and self._plain(self._trim(sentence)) in (WAIT, ""):
            return ""
        return super().match(f"{self._trim(player)}: {self._trim(sentence)}", valid)


class Joint:
    """One strategy, and so one conversation, for all seats: in each step it is asked once.

    Args:
        strategy: Reads answers as `JointAnswers`.
    """

    def __init__(self, strategy: Strategy, complete: Complete) -> None:
        self._strategy = strategy
        self._complete = complete
        self._refusals = Refusals()
        self._answers = JointAnswers()
        self._done = False

    async def propose(self, seen: Mapping[str, Observation], take: Take) -> None:
        """All at once. What the model was asked belongs to the first seat."""
        proposal = Proposal(done=True)
        if not self._done:
            shown = joint_observation(seen)
            shown = replace(shown, text=self._refusals.before(shown.text))
            proposal = await answer_all(self._strategy.propose(shown), self._complete)
            exchanges = tuple(self._of_one(each, shown) for each in proposal.exchanges)
            proposal = replace(proposal, exchanges=exchanges)
            self._done = proposal.done
        for player, own in _divided(proposal, list(seen)).items():
            take(player, own)

    def _of_one(self, exchange: Exchange, shown: Observation) -> Exchange:
        """What was refused is the action of one robot."""
        if exchange.verdict is not ExchangeVerdict.INVALID:
            return exchange
        named, sentence = self._answers.refused(exchange.action, shown.valid)
        players = {line.partition(":")[0] for line in shown.valid}
        player = next((each for each in players if each.casefold() == named.casefold()), "")
        return replace(exchange, action=sentence or exchange.action, player=player)

    def observe(self, did: Did) -> None:
        """What everybody did in a step."""
        self._strategy.observe(did)

    def refused(self, player: str, action: str, reasons: Sequence[str]) -> None:
        """Is told in the next request."""
        self._refusals.add(player, action, reasons)


def _divided(proposal: Proposal, players: Sequence[str]) -> dict[str, Proposal]:
    """What each of some players does by a proposal for all of them. The reasoning is that of the
    first who acts; what was asked and said belongs to the first of all."""
    lines = [line.partition(": ") for action in proposal.actions for line in action.split("\n")]
    chosen = {player: sentence for player, _, sentence in lines if player}
    thinker = next((player for player in players if player in chosen), players[0])
    divided = {}
    for player in players:
        actions = (chosen[player],) if player in chosen else ()
        reasoning = proposal.reasoning if player == thinker else ""
        divided[player] = Proposal(actions, reasoning, done=proposal.done)
    first = divided[players[0]]
    divided[players[0]] = replace(first, say=proposal.say, exchanges=proposal.exchanges)
    return divided


def joint_observation(seen: Mapping[str, Observation]) -> Observation:
    """The state in words once, and the valid actions of every player, each with its name."""
    player, first = next(iter(seen.items()))
    own = "\n".join(["Valid Actions:", *first.valid])
    valid = tuple(f"{name}: {each}" for name, one in seen.items() for each in one.valid)
    for_all = "\n".join(["Valid Actions:", *valid])
    text = first.text.removeprefix(f"You are {player}.\n\n").replace(own, for_all, 1)
    heard = tuple(line for one in seen.values() for line in one.heard)
    text = f"You decide for {_and(list(seen))} now.\n\n{text}"
    return Observation(text, valid, player, first.state, heard)


def _and(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
