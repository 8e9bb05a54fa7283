"""Settings of experiments: the values that this package uses, and their valid ranges."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, ValidationError

Word = str | int | float | None
"""Part of a prompt's name; None for the agent `human`, which has no prompt."""

Count = Annotated[int, Field(ge=0, le=1000)]
MAX_STEPS = 1_000_000


class _PromptName(BaseModel):
    experiment_name: Word
    prompt_version: Word
    prompt_description: Word


class _Prompts(BaseModel):
    action_proposal_prompt: _PromptName


class _WithReflection(_Prompts):
    reflection_prompt: _PromptName


class _Llm(BaseModel):
    prompts: _Prompts
    temperature: Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)] | None = None
    num_examples: Count | None = None
    feedback_attempts: Count = 3
    retries: Count = 0


class _WithExamples(_Llm):
    example_dir_path: str


class _Reflecting(_Llm):
    prompts: _WithReflection


class _Game(BaseModel):
    stochastic: bool | None = None
    noisy_randomization: bool | None = None
    max_steps: Annotated[int, Field(ge=1, le=MAX_STEPS)] | None = None
    max_step_multiplier: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)] = 1


class _Settings(BaseModel):
    evaluation: Mapping[str, Any] = {}
    game: _Game = _Game()
    llm: _Llm


def setting_faults(agent: str, settings: Mapping[str, Any]) -> list[str]:
    """Return the faults of an experiment's settings with their places."""
    faults = _faults(_Settings, settings)
    if faults:
        return faults
    llm = settings["llm"]
    if llm.get("num_examples"):
        faults += _faults(_WithExamples, llm, "llm")
    if agent == "Reflexion":
        faults += _faults(_Reflecting, llm, "llm")
    return faults


def _faults(model: type[BaseModel], value: object, *place: Literal["llm"]) -> list[str]:
    try:
        # The run uses the values as they are, so a text such as "no" must not pass as false.
        model.model_validate(value, strict=True)
    except ValidationError as error:
        found = error.errors(include_url=False)
        return [f"{'.'.join(map(str, (*place, *each['loc'])))}: {each['msg']}" for each in found]
    return []
