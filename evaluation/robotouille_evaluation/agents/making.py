"""Strategies by name: those of a pack's experiments, and our own with a pack's prompts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from robotouille.errors import RobotouilleError, UnknownNameError, did_you_mean
from robotouille_evaluation.agents.answers import Tolerant
from robotouille_evaluation.agents.histories import History
from robotouille_evaluation.agents.plan_once import PlanOnce
from robotouille_evaluation.agents.proposal import Strategy
from robotouille_evaluation.agents.react import Prompts, ReAct, ReActSettings
from robotouille_evaluation.agents.reflexion import Reflexion
from robotouille_evaluation.agents.teams.joint import JointAnswers
from robotouille_evaluation.agents.teams.team import Control
from robotouille_evaluation.packs.pack import Experiment, Pack

__all__ = [
    "OWN_STRATEGIES",
    "make_strategy",
    "own_strategy",
    "published_strategy",
    "team_strategy",
]

FLAGS = {
    "is_no_history": History.NONE,
    "is_last_action": History.LAST_ACTION,
    "is_last_reasoning_action": History.LAST_REASONING_ACTION,
    "is_last_obs_reasoning_action": History.LAST_OBSERVATION_REASONING_ACTION,
}
"""Settings of the published code, in the order in which it asks for them."""


def make_strategy(pack: Pack, name: str, dataset: str) -> Strategy:
    """A new strategy for one episode.

    Args:
        name: The id of an experiment of the pack, or one of `OWN_STRATEGIES`.
        dataset: Whose examples are shown.

    Raises:
        UnknownNameError: There is none of this name; the nearest are named.
    """
    experiments = {experiment.id: experiment for experiment in pack.experiments}
    if name in experiments:
        return published_strategy(pack, experiments[name])
    if name in OWN_STRATEGIES:
        return own_strategy(pack, name, dataset)
    known = [*OWN_STRATEGIES, *experiments]
    raise UnknownNameError(f"no strategy {name!r}{did_you_mean(name, known)}")


# One for all seats


def team_strategy(pack: Pack, name: str, dataset: str, control: Control) -> Strategy:
    """The strategy of a model that plays several seats, in `turns` or `joint`.

    Raises:
        UnknownNameError: There is none of this name, or the pack has no prompt for it.
        RobotouilleError: This one cannot play several seats so.
    """
    strategy = make_strategy(pack, name, dataset)
    if name not in OWN_STRATEGIES:
        raise RobotouilleError(
            f"{name} is played as published, with a conversation for each robot: "
            f"no --control {control}"
        )
    if name == "reflexion":
        raise RobotouilleError(f"{name} begins anew after a failure, alone: no --control {control}")
    if control != "joint":
        return strategy
    history = JOINT_HISTORIES.get(name)
    if history is None:
        raise RobotouilleError(
            f"{name} cannot be asked for all robots at once; --control joint takes "
            + ", ".join(JOINT_HISTORIES)
        )
    settings = ReActSettings(history, parser=JointAnswers(), truncate=True, talks=True)
    return ReAct(_own_prompts(pack, "joint", dataset), settings)


JOINT_HISTORIES = {f"react-{history.value}": history for history in History}
"""Strategies that can be asked for all seats at once: the history is theirs, the prompt another."""


# As published


def published_strategy(pack: Pack, experiment: Experiment) -> Strategy:
    """What an experiment of the published code asks, message for message."""
    settings: Mapping[str, Any] = experiment.settings["llm"]
    prompts = _published_prompts(pack, settings, "action_proposal_prompt")
    if experiment.agent == "io":
        return PlanOnce(prompts)
    if experiment.agent == "io-cot":
        return PlanOnce(prompts, chain_of_thought=True)
    history = next((FLAGS[flag] for flag in FLAGS if settings.get(flag)), History.FULL)
    react = ReActSettings(
        history=history,
        rules=str(settings.get("prior") or ""),
        max_failures=int(settings.get("feedback_attempts", 3)),
    )
    if experiment.agent == "Reflexion":
        reflection = _published_prompts(pack, settings, "reflection_prompt", examples=False)
        return Reflexion(prompts, reflection, react, int(settings.get("retries", 0)))
    return ReAct(prompts, react)


def _published_prompts(
    pack: Pack, settings: Mapping[str, Any], which: str, *, examples: bool = True
) -> Prompts:
    wanted = settings["prompts"][which]
    name = "{experiment_name}/{prompt_version}-{prompt_description}".format(**wanted)
    prompt = pack.prompt(name)
    shown: tuple[tuple[str, str], ...] = ()
    if examples and settings.get("num_examples"):
        shown = _turns(pack, str(settings["example_dir_path"]))
    return Prompts(prompt.system, prompt.instructions, shown)


def _turns(pack: Pack, name: str) -> tuple[tuple[str, str], ...]:
    episodes = pack.example_set(name).episodes
    return tuple((step.user, step.assistant) for episode in episodes for step in episode.steps)


# Our own


def own_strategy(pack: Pack, name: str, dataset: str) -> Strategy:
    """One of ours: answers are read with more patience, and long histories are cut."""
    return OWN_STRATEGIES[name](pack, dataset)


def _own_prompts(pack: Pack, id_: str, dataset: str, examples: str = "") -> Prompts:
    prompt = pack.prompt(id_)
    shown = _turns(pack, _nearest(pack, dataset, examples)) if examples else ()
    return Prompts(prompt.system, prompt.instructions, shown)


def _nearest(pack: Pack, dataset: str, form: str) -> str:
    """The examples of a data set; those of the last one where it has none of its own."""
    names = [found.name for found in pack.examples if found.name.endswith(f"/{form}")]
    wanted = f"{dataset}/{form}"
    return wanted if wanted in names or not names else names[-1]


def _plan(prompt: str, examples: str, *, chain: bool) -> Callable[[Pack, str], Strategy]:
    def make(pack: Pack, dataset: str) -> Strategy:
        prompts = _own_prompts(pack, prompt, dataset, examples)
        return PlanOnce(prompts, chain_of_thought=chain, parser=Tolerant())

    return make


def _react(
    history: History,
    *,
    prompt: str = "react",
    complete_plan: bool = False,
    repeat_rules: bool = False,
    examples: str = "react",
    talks: bool = False,
) -> Callable[[Pack, str], Strategy]:
    def make(pack: Pack, dataset: str) -> Strategy:
        id_ = f"{prompt}-plan" if complete_plan else prompt
        rules = pack.prompt("rules").instructions if repeat_rules else ""
        settings = ReActSettings(history, rules, parser=Tolerant(), truncate=True, talks=talks)
        return ReAct(_own_prompts(pack, id_, dataset, examples), settings)

    return make


def _reflexion(pack: Pack, dataset: str) -> Strategy:
    settings = ReActSettings(History.LAST_REASONING_ACTION, parser=Tolerant(), truncate=True)
    prompts = _own_prompts(pack, "react-plan", dataset, "react")
    return Reflexion(prompts, _own_prompts(pack, "reflect", dataset), settings)


OWN_STRATEGIES: Mapping[str, Callable[[Pack, str], Strategy]] = {
    "io": _plan("io", "io", chain=False),
    "io-cot": _plan("io-cot", "io-cot", chain=True),
    **{
        f"react-{history.value}{'-plan' if plan else ''}": _react(history, complete_plan=plan)
        for history in History
        for plan in (False, True)
    },
    "react-rules": _react(History.LAST_REASONING_ACTION, prompt="react-rules", complete_plan=False),
    "react-repeated-rules": _react(History.LAST_REASONING_ACTION, repeat_rules=True),
    "react-talk": _react(History.LAST_REASONING_ACTION, prompt="react-talk", talks=True),
    "plag": _react(History.LAST_REASONING_ACTION, prompt="plag", examples=""),
    "reflexion": _reflexion,
}
"""Our strategies by name: `react-` with a history, `-plan` where the whole plan is thought of."""
