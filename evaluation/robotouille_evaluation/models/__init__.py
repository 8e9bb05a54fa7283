"""Language models: what they are asked and what they answer."""

from robotouille_evaluation.models.model import Completion, Message, Model, ModelRequest, Usage

__all__ = ["Completion", "Message", "Model", "ModelRequest", "Usage"]
