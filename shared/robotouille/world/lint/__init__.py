"""What is wrong with a domain or a problem, or with what they look like, although it loads."""

from robotouille.world.lint.companions import lint_input
from robotouille.world.lint.linting import (
    lint_domain,
    lint_domain_file,
    lint_task,
    reachable_facts,
)
from robotouille.world.lint.looks import lint_look, lint_rendering
from robotouille.world.lint.sound import sound_task

__all__ = [
    "lint_domain",
    "lint_domain_file",
    "lint_input",
    "lint_look",
    "lint_rendering",
    "lint_task",
    "reachable_facts",
    "sound_task",
]
