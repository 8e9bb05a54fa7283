"""What we tell language models: prompts written for this project, and examples.

The texts are files beside this module. Examples are the shortest plans of the training tasks, with
a thought for each step; only the first observation of an example is shown whole.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib.resources import files
from typing import Any

from robotouille import State, World, load_task
from robotouille.domain.schema import DomainFile
from robotouille.planning import read_plan
from robotouille.resources import data_folder
from robotouille_evaluation.packs.pack import ExampleEpisode, Examples, ExampleStep, Prompt

__all__ = ["own_examples", "own_prompts"]

NAMES = (
    *("react", "react-plan", "react-rules", "react-talk", "joint"),
    *("plag", "io", "io-cot", "reflect", "rules"),
)
BETWEEN = "\n---\n"
PLACEHOLDERS = ("kitchen", "rules")
OMITTED = "..."


def own_prompts(domain: DomainFile) -> tuple[Prompt, ...]:
    """All prompts; `rules` has instructions only."""
    return tuple(_prompt(name, domain) for name in NAMES)


def _prompt(name: str, domain: DomainFile) -> Prompt:
    system, between, instructions = _text(name).partition(BETWEEN)
    if not between:
        system, instructions = "", system
    for word in PLACEHOLDERS:
        instructions = instructions.replace(f"{{{word}}}", _text(word))
    actions = "\n".join(f"- {action.language_description}" for action in domain.action_defs)
    return Prompt(name, system, instructions.replace("{actions}", actions))


def _text(name: str) -> str:
    return (files(__package__) / "prompts" / f"{name}.md").read_text(encoding="utf-8").strip()


def own_examples() -> tuple[Examples, ...]:
    """Examples for each data set and form of answer, such as `synchronous/react`."""
    raw = json.loads((files(__package__) / "prompts/examples.json").read_text(encoding="utf-8"))
    found = []
    for dataset, example in raw.items():
        world, plan = _shown(example["task"])
        for form, steps in (
            ("react", tuple(_react(world, plan, example["reasoning"]))),
            ("io", (_io(world, plan),)),
            ("io-cot", (_io_cot(world, plan),)),
        ):
            episode = ExampleEpisode(example["task"], steps)
            found.append(Examples(f"{dataset}/{form}", (episode,)))
    return tuple(found)


def _shown(name: str) -> tuple[World, list[Any]]:
    """A training task, and the actions of the plan beside it."""
    world = World(load_task(name))
    path = data_folder("problems") / f"{name}.plan"
    plan = read_plan(path.read_text(encoding="utf-8"), world, str(path))
    return world, [step[0] for step in plan]


def _react(world: World, plan: list[Any], reasoning: list[str]) -> Iterator[ExampleStep]:
    state: State = world.initial
    goal = f"Goal: {world.task.goal_description}"
    seen = state.text_view(world.players[0])
    for action, thought in zip(plan, reasoning, strict=True):
        yield ExampleStep(seen, f"Reasoning: {thought}\nAction: {action.sentence}")
        state = state.step(action).state
        seen = f"{OMITTED}\n\nValid Actions:\n{OMITTED}\n\n{goal}"


def _io(world: World, plan: list[Any]) -> ExampleStep:
    lines = "\n".join(action.sentence for action in plan)
    return ExampleStep(world.initial.text_view(world.players[0]), f"Plan:\n{lines}")


def _io_cot(world: World, plan: list[Any]) -> ExampleStep:
    state, lines = world.initial, []
    for action in plan:
        after = state.step(action).state
        added = sorted(set(after.text().splitlines()) - set(state.text().splitlines()))
        facts = [line for line in added if line not in _actions(after)]
        lines += [f"Action: {action.sentence}", f"Then: {'; '.join(facts) or 'a step has passed'}"]
        state = after
    return ExampleStep(world.initial.text_view(world.players[0]), "\n".join(lines))


def _actions(state: State) -> set[str]:
    return {action.sentence for action in state.actions(state.world.players[0])}
