"""Client of the environment's server."""

from __future__ import annotations

from typing import Any

from openenv.core import EnvClient
from openenv.core.client_types import StepResult

from robotouille_env.models import RobotouilleAction, RobotouilleObservation, RobotouilleState


class RobotouilleEnv(EnvClient[RobotouilleAction, RobotouilleObservation, RobotouilleState]):
    """Session of one game.

    with RobotouilleEnv(base_url="http://localhost:8000").sync() as env:
        result = env.reset(task="synchronous/01")
        result = env.step(RobotouilleAction(message=result.observation.legal_actions[0]))
    """

    def _step_payload(self, action: RobotouilleAction) -> dict[str, Any]:
        return {"message": action.message}

    def _parse_result(self, payload: dict[str, Any]) -> StepResult[RobotouilleObservation]:
        reward, done = payload.get("reward"), payload.get("done", False)
        fields = {**payload.get("observation", {}), "reward": reward, "done": done}
        observation = RobotouilleObservation.model_validate(fields)
        return StepResult(observation=observation, reward=reward, done=done)

    def _parse_state(self, payload: dict[str, Any]) -> RobotouilleState:
        state: RobotouilleState = RobotouilleState.model_validate(payload)
        return state
