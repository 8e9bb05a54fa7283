"""Teams of models: joint answers and messages between players."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

import pytest

from robotouille_evaluation.agents.joint_team import JointAnswers, joint_observation
from robotouille_evaluation.agents.making import make_strategy
from robotouille_evaluation.agents.proposal import AgentObservation, Complete, Proposal
from robotouille_evaluation.agents.team import IndependentTeam
from robotouille_evaluation.models import Completion, ModelRequest
from robotouille_evaluation.packs.own import build_own_pack
from tests.support.virtual_time import run

ONE, TWO = "robot1: Move robot1 from table1 to stove1", "robot2: Cut lettuce1"
VALID = (ONE, "robot1: Do nothing", TWO, "robot2: Do nothing")
BOTH = f"{ONE}\n{TWO}"


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        (f"Reasoning: so.\nActions:\n{ONE}\n{TWO}", BOTH),
        (f"Reasoning: so.\n\n**Actions:**\n\n- {ONE}.\n- {TWO.upper()}", BOTH),
        (f"Reasoning: so.\nActions:\n1. {ONE}\n2. {TWO}", BOTH),
        (f"Reasoning: so.\nActions:\n**robot1**:{ONE[7:]}\n`robot2`:{TWO[7:]}", BOTH),
        (f"Reasoning: so.\nAction: {ONE}\nAction: {TWO}", BOTH),
        (f"Reasoning: so.\nActions: {ONE}\n{TWO}", BOTH),
        (f"Reasoning: so.\nActions:\nrobot1: Fly\nActions:\n{ONE}\n{TWO}", BOTH),
        (f"Reasoning: so.\nActions:\nrobot1: Fly\n{ONE}\n{TWO}", BOTH),
        (f"Reasoning: so.\nActions:\n{TWO}", TWO),
        (f"Reasoning: so.\nActions:\nrobot1: wait\n{TWO}", TWO),
        ("Reasoning: so.\nActions:\nrobot1: wait\nrobot2: Wait.", ""),
        (f"Reasoning: so.\nActions:\nrobot1: Do nothing\n{TWO}", f"robot1: Do nothing\n{TWO}"),
    ],
)
def test_lines_of_robots_are_read(text: str, meant: str) -> None:
    answers = JointAnswers()
    parsed = answers.step(text)
    assert parsed.reasoning == "so."
    assert parsed.action is not None
    assert answers.match(parsed.action, VALID) == meant


@pytest.mark.parametrize(
    ("lines", "expected", "whose"),
    [
        ("robot1: Cut lettuce1", "The action 'Cut lettuce1' of robot1 is not valid.", "robot1"),
        (f"{TWO}\nrobot7: Fly", "The action 'Fly' of robot7 is not valid.", "robot7"),
        ("Fly away", "'Fly away' is no line of a robot.", "Fly away"),
        (
            "robot1: Fly\nrobot2: Swim",
            "The action 'Fly' of robot1 is not valid. The action 'Swim' of robot2 is not valid.",
            "robot1",
        ),
    ],
)
def test_feedback_names_invalid_actions_and_robots(lines: str, expected: str, whose: str) -> None:
    answers = JointAnswers()
    assert answers.match(lines, VALID) is None
    assert answers.invalid(lines, VALID).startswith(f"{expected} Nobody has acted.")
    assert answers.first_invalid(lines, VALID)[0] == whose


@pytest.mark.parametrize("text", ["", "Reasoning: so.", "Reasoning: so.\nActions:\n\n", "robot1:"])
def test_answers_without_lines_are_malformed(text: str) -> None:
    assert JointAnswers().step(text).action is None


def test_joint_observation_has_one_state_and_all_actions() -> None:
    def seen(player: str, *valid: str) -> AgentObservation:
        listed = "\n".join(valid)
        text = f"You are {player}.\n\nStove stove1:\n\nValid Actions:\n{listed}\n\nGoal: a soup"
        return AgentObservation(text, valid, player)

    shown = joint_observation(
        {"robot1": seen("robot1", "Go", "Cut"), "robot3": seen("robot3", "Cook")}
    )
    assert shown.valid == ("robot1: Go", "robot1: Cut", "robot3: Cook")
    assert shown.text == (
        "You decide for robot1 and robot3 now.\n\nStove stove1:\n\n"
        "Valid Actions:\nrobot1: Go\nrobot1: Cut\nrobot3: Cook\n\nGoal: a soup"
    )


SEEN = {
    player: AgentObservation(f"You are {player}.", ("Do nothing",), player)
    for player in ("robot1", "robot2", "robot3")
}


class Players:
    """Models that answer after a time."""

    def __init__(self, seconds: Mapping[str, float]) -> None:
        self.asked: dict[str, list[str]] = {player: [] for player in SEEN}
        self.took: list[str] = []
        pack = build_own_pack()
        strategies = {p: make_strategy(pack, "react-talk", "multi_agent") for p in SEEN}
        self.team = IndependentTeam(strategies, {p: self._slow(p, seconds[p]) for p in SEEN})

    def _slow(self, player: str, seconds: float) -> Complete:
        async def complete(request: ModelRequest) -> Completion:
            self.asked[player].append(request.messages[-1].content)
            await asyncio.sleep(seconds)
            return Completion(f"Reasoning: so.\nSay: I am {player}\nAction: Do nothing")

        return complete

    def take(self, player: str, proposal: Proposal) -> None:
        assert proposal.exchanges
        self.took.append(player)


def test_messages_are_delivered_in_seat_order() -> None:
    """A resumed run is answered at once and must send the same requests."""
    expected = []
    for seconds in ({"robot1": 9, "robot2": 1, "robot3": 5}, dict.fromkeys(SEEN, 0)):
        players = Players(seconds)
        for _ in range(2):
            run(players.team.propose(SEEN, players.take))
        assert players.took == [*SEEN, *SEEN]
        expected.append(players.asked)
    assert expected[0] == expected[1]
    received = expected[0]["robot3"][1]
    assert received.index("I am robot1") < received.index("I am robot2")
