"""Checks for mistakes in domains, problems, key bindings and renderings that load."""

from robotouille.world.lint.linting import (
    faults_for,
    lint_domain,
    lint_domain_file,
    lint_input,
    lint_problem_file,
    lint_task,
    reachable_facts,
    sound_task,
)
from robotouille.world.lint.looks import lint_look, lint_rendering

__all__ = [
    "faults_for",
    "lint_domain",
    "lint_domain_file",
    "lint_input",
    "lint_look",
    "lint_problem_file",
    "lint_rendering",
    "lint_task",
    "reachable_facts",
    "sound_task",
]
