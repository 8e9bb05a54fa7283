"""Invented checkout in the format of the published repository."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from robotouille.installation import data_folder

__all__ = ["EXPERIMENT", "PROBLEM", "write_checkout"]

PROBLEM = {
    "version": "1.0.0",
    "width": 5,
    "height": 5,
    "config": {},
    "stations": [{"name": "table", "x": x, "y": 1} for x in range(4)],
    "items": [
        {"name": "bread", "x": 0, "y": 1, "stack-level": 0},
        {"name": "cheese", "x": 1, "y": 1, "stack-level": 0},
    ],
    "players": [{"name": "robot", "x": 0, "y": 0, "direction": [0, 1]}],
    "goal_description": "Put cheese on bread",
    "goal": [{"predicate": "atop", "args": ["cheese", "bread"], "ids": [1, 2]}],
}
EXAMPLE = """\
Interaction 1
---------------


Observation:
...

Goal: Put cheese on bread


Reasoning: It is there.

Action: Do nothing


"""
EXPERIMENT = """\
# @package _global_
defaults:
  - override /evaluation: base_evaluation
  - override /game: base_game
  - override /llm: base_llm
evaluation:
  evaluate: true
  environment_names: ["synchronous/0_toast", "synchronous/1_absent"]
  optimal_steps: [5, 9]
  testing_seeds: [42]
game:
  agent_name: ReAct
  max_steps: null
  max_step_multiplier: 1.5
llm:
  num_examples: 1
  example_dir_path: synchronous/examples
  log_path: ${hydra:runtime.output_dir}/log
  prompts:
    action_proposal_prompt:
      experiment_name: ReAct
      prompt_description: plain
      prompt_version: 1.0.0
"""
FILES = {
    "conf/config.yaml": (
        "defaults:\n  - evaluation: base_evaluation\n  - llm: base_llm\n  - game: base_game\n"
    ),
    "conf/evaluation/base_evaluation.yaml": "evaluate: false\ntesting_seeds: [1, 2]\n",
    "conf/game/base_game.yaml": "agent_name: human\nmax_steps: 100\nstochastic: false\n",
    "conf/llm/base_llm.yaml": (
        "temperature: 0.7\nprompts:\n  action_proposal_prompt:\n"
        "    experiment_name: null\n    temperature: ${llm.temperature}\n"
    ),
    "conf/experiments/ReAct/plain.yaml": EXPERIMENT,
    "agents/prompt_builder/prompts/ReAct/1.0.0-plain.yml": (
        "system: |\n  Be a cook.\ninstructions: |\n  Answer so:\n  Reasoning: ...\n  Action: ...\n"
    ),
    "agents/in_context_examples/data/synchronous/examples/0_toast_26.txt": EXAMPLE,
    "environments/env_generator/examples/synchronous/0_toast.json": json.dumps(PROBLEM),
}


def write_checkout(folder: Path, changes: dict[str, str | None] | None = None) -> Path:
    """Write the checkout; `changes` replaces texts of files, and None omits a file."""
    domain: dict[str, Any] = json.loads(
        (data_folder("domains") / "robotouille.json").read_text(encoding="utf-8")
    )
    for path, text in {
        **FILES,
        "domain/robotouille.json": json.dumps(domain),
        **(changes or {}),
    }.items():
        if text is not None:
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text, encoding="utf-8")
    return folder
