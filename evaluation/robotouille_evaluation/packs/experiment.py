"""Experiments of the published repository."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robotouille_evaluation.packs.budget import Budget, published_budget


@dataclass(frozen=True, slots=True)
class Experiment:
    """Published experiment: agent, tasks with their constants, seeds and settings.

    `settings` has the groups `evaluation`, `game` and `llm` of the published code.
    """

    id: str
    agent: str
    tasks: tuple[str, ...]
    optimal_steps: tuple[int, ...]
    seeds: tuple[int, ...]
    settings: Mapping[str, Any]

    def __post_init__(self) -> None:
        # Files of packs may come from other people. With a colon, the id of an experiment would
        # also be the name of an agent in a Python module, which would be imported.
        if ":" in self.id:
            raise ValueError(f"{self.id}: the id of an experiment has no colon")
        if len(self.optimal_steps) != len(self.tasks):
            raise ValueError(
                f"{self.id}: {len(self.tasks)} tasks, but {len(self.optimal_steps)} optimal_steps"
            )

    @property
    def prompt_ids(self) -> tuple[str, ...]:
        """Ids of the prompts that the settings name."""
        prompts = self.settings["llm"]["prompts"]
        named = (prompt for prompt in prompts.values() if isinstance(prompt, Mapping))
        return tuple(
            f"{p['experiment_name']}/{p.get('prompt_version')}-{p.get('prompt_description')}"
            for p in named
            if p.get("experiment_name")
        )

    def budget(self, task: str) -> Budget | None:
        """Return the step budget of a task; None if the experiment does not play it.

        Settings with `max_steps` replace the constants. As in the published code, the multiplier
        applies to them, too.
        """
        constants = dict(zip(self.tasks, self.optimal_steps, strict=True))
        if task not in constants:
            return None
        game = self.settings.get("game", {})
        fixed = game.get("max_steps")
        steps = constants[task] if fixed is None else fixed
        return published_budget(steps, game.get("max_step_multiplier", 1))

    @property
    def temperature(self) -> float | None:
        """Temperature of each request; None for the endpoint's own."""
        found = self.settings["llm"].get("temperature")
        return None if found is None else float(found)

    @property
    def stochastic(self) -> bool:
        """True if a cut item may become uncut by chance."""
        return bool(self.settings.get("game", {}).get("stochastic"))

    @property
    def noisy(self) -> bool:
        """True if the instances of its seeds are of the kind `noisy`."""
        return bool(self.settings.get("game", {}).get("noisy_randomization"))

    @property
    def shown(self) -> tuple[str, ...]:
        """Names of the examples that the settings name."""
        folder = self.settings["llm"].get("example_dir_path")
        return (folder,) if isinstance(folder, str) and folder else ()
