"""Action, observation and state of a game, as JSON on the wire."""

from __future__ import annotations

from typing import Any

from openenv.core.env_server.types import Action, Observation, State
from pydantic import Field


class RobotouilleAction(Action):
    """Answer of a model."""

    message: str = Field(
        description="A model's answer with a line 'Action: ...', or one of the legal actions alone"
    )


class RobotouilleObservation(Observation):
    """Next message to the model, and what is known about the game."""

    text: str = Field(default="", description="Next message to the model; empty after the end")
    prompt: list[dict[str, str]] = Field(
        default_factory=list,
        description="After a reset: the messages before the text, with role and content",
    )
    legal_actions: list[str] = Field(default_factory=list, description="Actions possible now")
    feedback: str = Field(default="", description="Reason why the last answer was rejected")
    player: str = Field(default="", description="Player for whom the model is asked")
    score: dict[str, Any] = Field(default_factory=dict, description="After the end: the score")


class RobotouilleState(State):
    """State of a session."""

    instance: str = Field(default="", description="Name of the instance; empty before a reset")
    players: list[str] = Field(default_factory=list, description="Players of the kitchen")
    score: dict[str, Any] = Field(default_factory=dict, description="Score so far")
