"""Agents: their observations, strategies for asking language models, and parsers of answers."""

from robotouille_evaluation.agents.answers import (
    AnswerParser,
    ParsedAnswer,
    PromptHistory,
    PublishedParser,
    TolerantParser,
)
from robotouille_evaluation.agents.proposal import (
    AgentObservation,
    ContextOverflow,
    Exchange,
    ExchangeVerdict,
    Proposal,
    ProposalSteps,
    Strategy,
)
from robotouille_evaluation.agents.react import PlanOnce, Prompts, ReAct, ReActSettings, Reflexion

__all__ = [
    "AgentObservation",
    "AnswerParser",
    "ContextOverflow",
    "Exchange",
    "ExchangeVerdict",
    "ParsedAnswer",
    "PlanOnce",
    "PromptHistory",
    "Prompts",
    "Proposal",
    "ProposalSteps",
    "PublishedParser",
    "ReAct",
    "ReActSettings",
    "Reflexion",
    "Strategy",
    "TolerantParser",
]
