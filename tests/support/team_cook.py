"""Scripted language model that plays a team's known plan."""

from __future__ import annotations

from robotouille.planning import Plan
from robotouille_evaluation.models import ModelRequest
from robotouille_evaluation.models.model import valid_actions

__all__ = ["NOTHING", "TeamCook"]

NOTHING = "Do nothing"


class TeamCook:
    """Scripted model; every robot does its part of a step as soon as that is valid."""

    def __init__(self, plan: Plan) -> None:
        self.steps = [{action.player: action.sentence for action in step} for step in plan]
        self.asked: list[str] = []

    def turns(self, request: ModelRequest) -> str:
        """Return the completion for one robot."""
        text = request.messages[-1].content
        self.asked.append(text)
        player = "robot1" if "You are robot1." in text else "robot2"
        return f"Reasoning: so.\nAction: {self._next(player, valid_actions(request))}"

    def joint(self, request: ModelRequest) -> str:
        """Return the completion for all robots."""
        self.asked.append(request.messages[-1].content)
        lines = [line.partition(": ") for line in valid_actions(request)]
        chosen = {
            player: self._next(player, tuple(s for p, _, s in lines if p == player))
            for player in dict.fromkeys(p for p, _, _ in lines)
        }
        return "Reasoning: so.\nActions:\n" + "\n".join(f"{p}: {s}" for p, s in chosen.items())

    def _next(self, player: str, valid: tuple[str, ...]) -> str:
        if player == "robot1" and not self.steps[0]:
            del self.steps[0]
        return self.steps[0].pop(player) if self.steps[0].get(player) in valid else NOTHING
