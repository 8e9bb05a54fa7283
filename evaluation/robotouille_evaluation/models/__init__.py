"""Language models: what they are asked and answer, and where they are.

Importing this imports neither the SDK of endpoints nor llama.cpp nor Inspect; making a model does.
"""

from __future__ import annotations

from robotouille_evaluation.models.inspect_provider import InspectModel, open_inspect_model
from robotouille_evaluation.models.local import LocalModel
from robotouille_evaluation.models.model import (
    Completion,
    Message,
    Model,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    Usage,
)
from robotouille_evaluation.models.openai_compatible import Endpoint, OpenAICompatibleModel
from robotouille_evaluation.models.prices import Prices
from robotouille_evaluation.models.retries import RetryPolicy
from robotouille_evaluation.models.scripted import (
    AnswerForm,
    AnswerKind,
    ScriptedModel,
    SeededAnswers,
)

__all__ = [
    "AnswerForm",
    "AnswerKind",
    "Completion",
    "Endpoint",
    "InspectModel",
    "LocalModel",
    "Message",
    "Model",
    "ModelError",
    "ModelErrorKind",
    "ModelRequest",
    "OpenAICompatibleModel",
    "Prices",
    "RetryPolicy",
    "ScriptedModel",
    "SeededAnswers",
    "Usage",
    "open_inspect_model",
]
