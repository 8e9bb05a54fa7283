"""Strategies by name: experiments of a pack, and built-in strategies with the pack's prompts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from robotouille.errors import RobotouilleError, UnknownNameError, did_you_mean
from robotouille_evaluation.agents.answers import PromptHistory, TolerantParser
from robotouille_evaluation.agents.custom import custom_strategy, installed_agents, is_custom
from robotouille_evaluation.agents.joint_team import JointAnswers
from robotouille_evaluation.agents.proposal import Strategy
from robotouille_evaluation.agents.react import PlanOnce, Prompts, ReAct, ReActSettings, Reflexion
from robotouille_evaluation.agents.team import Control
from robotouille_evaluation.packs.experiment import Experiment
from robotouille_evaluation.packs.pack import Pack

FLAGS = {
    "is_no_history": PromptHistory.NONE,
    "is_last_action": PromptHistory.LAST_ACTION,
    "is_last_reasoning_action": PromptHistory.LAST_REASONING_ACTION,
    "is_last_obs_reasoning_action": PromptHistory.LAST_OBSERVATION_REASONING_ACTION,
}
"""Settings of the published code, in the order in which it reads them."""


def make_strategy(pack: Pack, name: str, dataset: str) -> Strategy:
    """Return a new strategy for one episode.

    Args:
        name: Id of an experiment of the pack, one of `OWN_STRATEGIES`, an installed agent, or
            `MODULE:NAME`.
        dataset: Dataset whose examples are shown.

    Raises:
        UnknownNameError: No strategy has this name.
    """
    experiments = {experiment.id: experiment for experiment in pack.experiments}
    if name in experiments:
        return published_strategy(pack, experiments[name])
    if name in OWN_STRATEGIES:
        return own_strategy(pack, name, dataset)
    if is_custom(name):
        return custom_strategy(name)
    installed = installed_agents()
    if name in installed:
        return custom_strategy(installed[name])
    known = [*OWN_STRATEGIES, *experiments, *installed]
    raise UnknownNameError(f"no strategy {name!r}{did_you_mean(name, known)}")


def team_strategy(pack: Pack, name: str, dataset: str, control: Control) -> Strategy:
    """Return the strategy of a model with several seats, for the control `turns` or `joint`.

    Raises:
        UnknownNameError: No strategy has this name, or the pack has no prompt for it.
        RobotouilleError: The strategy does not support this control.
    """
    strategy = make_strategy(pack, name, dataset)
    if is_custom(name):
        if control == "joint":
            raise RobotouilleError(f"{name} cannot be asked for all robots at once")
        return strategy
    if name not in OWN_STRATEGIES:
        raise RobotouilleError(
            f"{name} is played as published, with a conversation for each robot, "
            f"so --control {control} is not possible"
        )
    if name == "reflexion":
        raise RobotouilleError(
            f"{name} starts again after a failure, so it plays alone and not with "
            f"--control {control}"
        )
    if control != "joint":
        return strategy
    history = JOINT_HISTORIES.get(name)
    if history is None:
        raise RobotouilleError(
            f"{name} cannot be asked for all robots at once; with --control joint use "
            + ", ".join(JOINT_HISTORIES)
        )
    settings = ReActSettings(history, parser=JointAnswers(), truncate=True, talks=True)
    return ReAct(_own_prompts(pack, "joint", dataset), settings)


JOINT_HISTORIES = {f"react-{history.value}": history for history in PromptHistory}
"""Histories of the strategies that can be asked for all seats at once, with the joint prompt."""


def published_strategy(pack: Pack, experiment: Experiment) -> Strategy:
    """Return a strategy that sends the same messages as an experiment of the published code."""
    settings: Mapping[str, Any] = experiment.settings["llm"]
    prompts = _published_prompts(pack, settings, "action_proposal_prompt")
    if experiment.agent == "io":
        return PlanOnce(prompts)
    if experiment.agent == "io-cot":
        return PlanOnce(prompts, chain_of_thought=True)
    history = next((FLAGS[flag] for flag in FLAGS if settings.get(flag)), PromptHistory.FULL)
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


def own_strategy(pack: Pack, name: str, dataset: str) -> Strategy:
    """Return a built-in strategy, which parses tolerantly and shortens long histories."""
    return OWN_STRATEGIES[name](pack, dataset)


def _own_prompts(pack: Pack, id_: str, dataset: str, examples: str = "") -> Prompts:
    prompt = pack.prompt(id_)
    shown = _turns(pack, _nearest(pack, dataset, examples)) if examples else ()
    return Prompts(prompt.system, prompt.instructions, shown)


def _nearest(pack: Pack, dataset: str, form: str) -> str:
    """Return the name of a dataset's examples, or of the last dataset's if it has none."""
    names = [found.name for found in pack.examples if found.name.endswith(f"/{form}")]
    wanted = f"{dataset}/{form}"
    return wanted if wanted in names or not names else names[-1]


def _plan(prompt: str, examples: str, *, chain: bool) -> Callable[[Pack, str], Strategy]:
    def make(pack: Pack, dataset: str) -> Strategy:
        prompts = _own_prompts(pack, prompt, dataset, examples)
        return PlanOnce(prompts, chain_of_thought=chain, parser=TolerantParser())

    return make


def _react(
    history: PromptHistory,
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
        settings = ReActSettings(
            history, rules, parser=TolerantParser(), truncate=True, talks=talks
        )
        return ReAct(_own_prompts(pack, id_, dataset, examples), settings)

    return make


def _reflexion(pack: Pack, dataset: str) -> Strategy:
    settings = ReActSettings(
        PromptHistory.LAST_REASONING_ACTION, parser=TolerantParser(), truncate=True
    )
    prompts = _own_prompts(pack, "react-plan", dataset, "react")
    return Reflexion(prompts, _own_prompts(pack, "reflect", dataset), settings)


OWN_STRATEGIES: Mapping[str, Callable[[Pack, str], Strategy]] = {
    "io": _plan("io", "io", chain=False),
    "io-cot": _plan("io-cot", "io-cot", chain=True),
    **{
        f"react-{history.value}{'-plan' if plan else ''}": _react(history, complete_plan=plan)
        for history in PromptHistory
        for plan in (False, True)
    },
    "react-rules": _react(
        PromptHistory.LAST_REASONING_ACTION, prompt="react-rules", complete_plan=False
    ),
    "react-repeated-rules": _react(PromptHistory.LAST_REASONING_ACTION, repeat_rules=True),
    "react-talk": _react(PromptHistory.LAST_REASONING_ACTION, prompt="react-talk", talks=True),
    "plag": _react(PromptHistory.LAST_REASONING_ACTION, prompt="plag", examples=""),
    "reflexion": _reflexion,
}
"""Built-in strategies: `react-HISTORY`, with `-plan` if the prompt asks for a whole plan first."""

PAPER_REACT = "react-last-reasoning-action-plan"


def default_strategy(control: Control) -> str:
    """Return the paper's ReAct. The joint prompt has no plan, so `joint` gets ReAct without it."""
    return PAPER_REACT.removesuffix("-plan") if control == "joint" else PAPER_REACT


STRATEGY_WORDS: Mapping[str, str] = {
    "io": "asks once for the whole plan",
    "io-cot": "as io, with the effect of each action",
    "react-full": "asks for one action at a time and sends the whole conversation",
    "react-full-plan": "as react-full, and each answer contains the complete plan",
    "react-none": "asks for one action at a time and sends no history",
    "react-none-plan": "as react-none, and each answer contains the complete plan",
    "react-last-action": "asks for one action at a time and sends the last action",
    "react-last-action-plan": "as react-last-action, and each answer contains the complete plan",
    "react-last-reasoning-action": "asks for one action at a time and sends the last reasoning and "
    "action",
    PAPER_REACT: "as react-last-reasoning-action, and each answer contains the complete plan "
    "(the paper's ReAct)",
    "react-last-obs-reasoning-action": "asks for one action at a time and sends the last exchange",
    "react-last-obs-reasoning-action-plan": "as react-last-obs-reasoning-action, and each answer "
    "contains the complete plan",
    "react-rules": "as react-last-reasoning-action, with the rules in the instructions",
    "react-repeated-rules": "as react-last-reasoning-action, with the rules below each observation",
    "react-talk": "as react-last-reasoning-action, with chat in teams",
    "plag": "reasons with a graph of the remaining work",
    "reflexion": "plays a second time after reflecting on the first failure",
}
"""Description of each built-in strategy, in a line."""
