"""In-context examples: a played episode in the forms in which models answer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from robotouille import GroundAction, State
from robotouille_evaluation.packs.pack import ExampleEpisode, Examples, ExampleStep

OMITTED = "..."
REACT = "react"


@dataclass(frozen=True, slots=True)
class ExampleChoice:
    """Action of a player in a state, with the reasoning that leads to it."""

    state: State
    action: GroundAction
    reasoning: str


def episodes_by_form(name: str, choices: Sequence[ExampleChoice]) -> dict[str, ExampleEpisode]:
    """Return an episode by form of answer: `react`, and `io` and `io-cot` for a single player.

    Plans in teams are left out, because others change the kitchen between the player's actions.
    """
    forms: dict[str, tuple[ExampleStep, ...]] = {REACT: tuple(_react(choices))}
    if len(choices[0].state.world.players) == 1:
        forms |= {"io": (_io(choices),), "io-cot": (_io_cot(choices),)}
    return {form: ExampleEpisode(name, steps) for form, steps in forms.items()}


def example_sets(
    dataset: str, episodes: Sequence[Mapping[str, ExampleEpisode]]
) -> Iterator[Examples]:
    """Yield the examples of a data set for each form that all of the episodes have."""
    for form in episodes[0]:
        if all(form in each for each in episodes):
            yield Examples(f"{dataset}/{form}", tuple(each[form] for each in episodes))


def _player(choice: ExampleChoice) -> str:
    return choice.action.player or choice.state.world.players[0]


def _react(choices: Sequence[ExampleChoice]) -> Iterator[ExampleStep]:
    first = choices[0]
    goal = f"Goal: {first.state.world.task.goal_description}"
    seen = first.state.text_view(_player(first))
    for choice in choices:
        answer = f"Reasoning: {choice.reasoning}\nAction: {choice.action.sentence}"
        yield ExampleStep(seen, answer)
        # As in the published examples, later observations are left out. They would make each
        # request many times as long.
        seen = f"{OMITTED}\n\nValid Actions:\n{OMITTED}\n\n{goal}"


def _io(choices: Sequence[ExampleChoice]) -> ExampleStep:
    lines = "\n".join(choice.action.sentence for choice in choices)
    first = choices[0]
    return ExampleStep(first.state.text_view(_player(first)), f"Plan:\n{lines}")


def _io_cot(choices: Sequence[ExampleChoice]) -> ExampleStep:
    lines: list[str] = []
    for choice in choices:
        before, after = choice.state, choice.state.step(choice.action).state
        added = sorted(set(after.text().splitlines()) - set(before.text().splitlines()))
        facts = [line for line in added if line not in _sentences(after)]
        effect = "; ".join(facts) or "a step has passed"
        lines += [f"Action: {choice.action.sentence}", f"Then: {effect}"]
    first = choices[0]
    return ExampleStep(first.state.text_view(_player(first)), "\n".join(lines))


def _sentences(state: State) -> set[str]:
    return {action.sentence for action in state.actions(state.world.players[0])}
