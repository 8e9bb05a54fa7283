"""What Inspect finds by the entry point `robotouille`."""

from robotouille_evaluation.inspect_tasks.mock_model import MockModel
from robotouille_evaluation.inspect_tasks.play import play
from robotouille_evaluation.inspect_tasks.scores import outcome
from robotouille_evaluation.inspect_tasks.tasks import asynchronous, multi_agent, synchronous

__all__ = ["MockModel", "asynchronous", "multi_agent", "outcome", "play", "synchronous"]
