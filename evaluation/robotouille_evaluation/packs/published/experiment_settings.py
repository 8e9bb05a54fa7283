"""The settings of an experiment that agents are made of, checked when a pack is read.

The rest of what the published code hands over is kept as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, ValidationError

__all__ = ["setting_faults"]

Word = str | int | float | None
"""Part of a prompt's name; None where nobody is asked (agent `human`)."""

Count = Annotated[int, Field(ge=0, le=1000)]


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
    num_examples: Count | None = None
    feedback_attempts: Count = 3
    retries: Count = 0


class _WithExamples(_Llm):
    example_dir_path: str


class _Reflecting(_Llm):
    prompts: _WithReflection


class _Game(BaseModel):
    stochastic: bool | None = None


class _Settings(BaseModel):
    evaluation: Mapping[str, Any] = {}
    game: _Game = _Game()
    llm: _Llm


def setting_faults(agent: str, settings: Mapping[str, Any]) -> list[str]:
    """What is wrong with the settings of an experiment, each with its place."""
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
        model.model_validate(value)
    except ValidationError as error:
        found = error.errors(include_url=False)
        return [f"{'.'.join(map(str, (*place, *each['loc'])))}: {each['msg']}" for each in found]
    return []
