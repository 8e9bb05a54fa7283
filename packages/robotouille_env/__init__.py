"""Robotouille as an OpenEnv environment: models, client, and in `server` the HTTP server."""

from robotouille_env.client import RobotouilleEnv
from robotouille_env.models import RobotouilleAction, RobotouilleObservation, RobotouilleState

__all__ = ["RobotouilleAction", "RobotouilleEnv", "RobotouilleObservation", "RobotouilleState"]
