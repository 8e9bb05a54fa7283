"""What is wrong with a domain or a problem, or with what they look like, although it loads."""

from robotouille.world.lint.companions import lint_facts, lint_input, lint_pictures
from robotouille.world.lint.linting import (
    lint_domain,
    lint_domain_file,
    lint_task,
    reachable_facts,
)
from robotouille.world.lint.sound import sound_task

__all__ = [
    "lint_domain",
    "lint_domain_file",
    "lint_facts",
    "lint_input",
    "lint_pictures",
    "lint_task",
    "reachable_facts",
    "sound_task",
]
