"""Agents: what they see, how language models are asked, and how answers are read."""

from robotouille_evaluation.agents.answers import AnswerParser, ParsedAnswer, Published, Tolerant
from robotouille_evaluation.agents.histories import History
from robotouille_evaluation.agents.plan_once import PlanOnce
from robotouille_evaluation.agents.proposal import (
    ContextOverflow,
    Exchange,
    ExchangeVerdict,
    Observation,
    Proposal,
    ProposalSteps,
    Strategy,
)
from robotouille_evaluation.agents.react import Prompts, ReAct, ReActSettings
from robotouille_evaluation.agents.reflexion import Reflexion

__all__ = [
    "AnswerParser",
    "ContextOverflow",
    "Exchange",
    "ExchangeVerdict",
    "History",
    "Observation",
    "ParsedAnswer",
    "PlanOnce",
    "Prompts",
    "Proposal",
    "ProposalSteps",
    "Published",
    "ReAct",
    "ReActSettings",
    "Reflexion",
    "Strategy",
    "Tolerant",
]
