"""Robotouille as an environment for the library `verifiers`: data sets, rewards and agents.

env = load_environment("synchronous", "test", agent="react-full")
"""

# verifiers finds the plug-ins of a package here, and allows one of each kind. The defaults of the
# environment already need the harness, so both stand above its import.
__all__ = ["RobotouilleEnv", "RobotouilleHarness", "RobotouilleTaskset", "load_environment"]

from robotouille_verifiers.harness import RobotouilleHarness
from robotouille_verifiers.taskset import RobotouilleTaskset

# isort: split
from robotouille_verifiers.environment import RobotouilleEnv, load_environment
