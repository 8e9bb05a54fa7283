"""Robotouille as TextArena games; importing this package registers them.

import textarena
import robotouille_textarena

env = textarena.make("Robotouille-v0-multi_agent-01")
"""

from robotouille_textarena.env import RobotouilleTextEnv
from robotouille_textarena.registration import env_id, register_games

__all__ = ["RobotouilleTextEnv", "env_id", "register_games"]

register_games()
