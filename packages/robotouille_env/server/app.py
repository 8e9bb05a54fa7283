"""FastAPI application of the environment.

robotouille-env --port 8000
uvicorn robotouille_env.server.app:app --port 8000
"""

from __future__ import annotations

import argparse

import uvicorn
from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse
from openenv.core.env_server.http_server import create_app
from openenv.core.env_server.types import ConcurrencyConfig

from robotouille.errors import RobotouilleError
from robotouille_env.models import RobotouilleAction, RobotouilleObservation, RobotouilleState
from robotouille_env.server.environment import RobotouilleEnvironment
from robotouille_env.server.guard import MAX_BODY, Guard
from robotouille_evaluation.text_games import GameOptions

SESSIONS = 64
IDLE_SECONDS = 3600.0
MAX_WAITING = 2
"""Messages of a connection that wait for an answer."""


def make_app(options: GameOptions | None = None, sessions: int = SESSIONS) -> FastAPI:
    """Return the application.

    Args:
        options: Options of all games.
        sessions: Maximum number of WebSocket sessions at a time.
    """
    application: FastAPI = create_app(
        lambda: RobotouilleEnvironment(options),
        RobotouilleAction,
        RobotouilleObservation,
        env_name="robotouille_env",
        concurrency_config=ConcurrencyConfig(
            max_concurrent_envs=sessions, session_timeout=IDLE_SECONDS
        ),
        state_cls=RobotouilleState,
    )

    @application.exception_handler(RobotouilleError)
    async def refuse(request: Request, error: Exception) -> JSONResponse:
        return JSONResponse({"detail": str(error)}, status_code=422)

    application.add_middleware(Guard)
    return application


app = make_app()


def main() -> None:
    """Serve the environment."""
    parser = argparse.ArgumentParser(description="Serve Robotouille as an OpenEnv environment.")
    parser.add_argument("--host", default="127.0.0.1", help="address (default: 127.0.0.1)")
    parser.add_argument("--port", type=int, default=8000, help="port (default: 8000)")
    given = parser.parse_args()
    # By default, 32 messages of 16 MiB wait for each connection.
    uvicorn.run(
        app, host=given.host, port=given.port, ws_max_size=MAX_BODY, ws_max_queue=MAX_WAITING
    )


if __name__ == "__main__":
    main()
