"""Team with one model that is asked once per step. Its answer has a line for each seat.

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
from robotouille_evaluation.agents.answers import ParsedAnswer, TolerantParser
from robotouille_evaluation.agents.proposal import (
    AgentObservation,
    Complete,
    Exchange,
    ExchangeVerdict,
    Proposal,
    Strategy,
    answer_all,
)
from robotouille_evaluation.agents.team import RejectionNotices, Take

WAIT = "wait"
MAX_LINES = 32
"""Last lines of actions that are read; games have at most 16 seats."""
MAX_NAMED = 8
"""Most invalid lines that the feedback names."""


class JointAnswers(TolerantParser):
    """Parser of answers with a line for each robot; valid actions have the same form.

    The last line of a robot counts. Robots without a line, and robots that wait, do nothing.
    """

    no_action = (
        "The actions were malformed. Please provide 'Actions:' and below it a line for each robot, "
        "in the form '<robot>: <action>'."
    )
    _END = re.compile(TolerantParser._BEFORE + r"Actions?\b", re.MULTILINE | re.IGNORECASE)
    _HEADING = re.compile(
        TolerantParser._BEFORE + r"Action(s?)[ \t]?\d{0,3}[*_]{0,3}[ \t]?:[*_]{0,3}\s*(.*)",
        re.IGNORECASE,
    )

    def step(self, text: str) -> ParsedAnswer:
        """Read the lines after the last `Actions:`."""
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
        """Return the lines as valid actions, or None if one of them is invalid."""
        chosen = self._chosen(action, valid)
        if None in chosen.values():
            return None
        return "\n".join(line for line in chosen.values() if line)

    def invalid(self, action: str, valid: tuple[str, ...]) -> str:
        """Return feedback that names the robots with invalid actions."""
        rejected = [
            f"'{line}' is no line of a robot" if not sentence else
            f"The action '{sentence}' of {player} is not valid"
            for line, player, sentence in islice(self._invalid_lines(action, valid), MAX_NAMED)
        ]  # fmt: skip
        return f"{'. '.join(rejected)}. Nobody has acted. Please answer again, for all robots."

    def first_invalid(self, action: str, valid: tuple[str, ...]) -> tuple[str, str]:
        """Return robot and sentence of the first invalid line."""
        _, player, sentence = next(self._invalid_lines(action, valid))
        return player, sentence

    def _invalid_lines(self, action: str, valid: tuple[str, ...]) -> Iterator[tuple[str, str, str]]:
        for line, found in self._chosen(action, valid).items():
            if found is None:
                player, _, sentence = line.partition(":")
                yield line, self._trim(player), sentence.strip()

    def _chosen(self, action: str, valid: tuple[str, ...]) -> dict[str, str | None]:
        """Return the last line of each robot with its valid action.

        The action is empty if the robot waits, and None if the line is invalid.
        """
        # Later lines override earlier ones, because models think aloud before they decide.
        last: dict[str, str] = {}
        for line in action.split("\n"):
            last[self._plain(self._trim(line.partition(":")[0]))] = line
        return {line: self._meant(line, valid) for line in last.values()}

    def _meant(self, line: str, valid: tuple[str, ...]) -> str | None:
        player, colon, sentence = line.partition(":")
        if colon and self._plain(self._trim(sentence)) in (WAIT, ""):
            return ""
        return super().match(f"{self._trim(player)}: {self._trim(sentence)}", valid)


class JointTeam:
    """Team with one strategy for all seats, which is asked once per step.

    Args:
        strategy: Strategy whose parser is `JointAnswers`.
    """

    def __init__(self, strategy: Strategy, complete: Complete) -> None:
        self._strategy = strategy
        self._complete = complete
        self._notices = RejectionNotices()
        self._answers = JointAnswers()
        self._done = False

    async def propose(self, seen: Mapping[str, AgentObservation], take: Take) -> None:
        """Ask for all seats at once. The exchanges belong to the first seat."""
        proposal = Proposal(done=True)
        if not self._done:
            shown = joint_observation(seen)
            shown = replace(shown, text=self._notices.before(shown.text))
            proposal = await answer_all(self._strategy.propose(shown), self._complete)
            exchanges = tuple(self._of_one(each, shown) for each in proposal.exchanges)
            proposal = replace(proposal, exchanges=exchanges)
            self._done = proposal.done
        for player, own in _divided(proposal, list(seen)).items():
            take(player, own)

    def _of_one(self, exchange: Exchange, shown: AgentObservation) -> Exchange:
        """Return an invalid answer's exchange with the robot and action that are invalid."""
        if exchange.verdict is not ExchangeVerdict.INVALID:
            return exchange
        named, sentence = self._answers.first_invalid(exchange.action, shown.valid)
        players = {line.partition(":")[0] for line in shown.valid}
        player = next((each for each in players if each.casefold() == named.casefold()), "")
        return replace(exchange, action=sentence or exchange.action, player=player)

    def observe(self, did: Did) -> None:
        """Pass on what all players did in a step."""
        self._strategy.observe(did)

    def rejected(self, player: str, action: str, reasons: Sequence[str]) -> None:
        """Mention the rejection in the next request."""
        self._notices.add(player, action, reasons)


def _divided(proposal: Proposal, players: Sequence[str]) -> dict[str, Proposal]:
    """Divide a joint proposal among its players.

    The reasoning goes to the first player who acts, the exchanges and chat to the first player.
    """
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


def joint_observation(seen: Mapping[str, AgentObservation]) -> AgentObservation:
    """Return one observation for several players: the state once, and every player's actions."""
    player, first = next(iter(seen.items()))
    # The list of the first player is replaced by the lists of all of them.
    own = "\n".join(["Valid Actions:", *first.valid])
    valid = tuple(f"{name}: {each}" for name, one in seen.items() for each in one.valid)
    for_all = "\n".join(["Valid Actions:", *valid])
    text = first.text.removeprefix(f"You are {player}.\n\n").replace(own, for_all, 1)
    heard = tuple(line for one in seen.values() for line in one.heard)
    text = f"You decide for {_and(list(seen))} now.\n\n{text}"
    return AgentObservation(text, valid, player, first.state, heard)


def _and(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
