"""Language models: requests, completions, and the places where models run.

Importing this package imports neither the OpenAI SDK nor llama.cpp nor Inspect. They are imported
when a model is made.
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
    "ScriptedModel",
    "SeededAnswers",
    "Usage",
    "open_inspect_model",
]
