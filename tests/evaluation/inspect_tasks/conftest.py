"""Evaluations by Inspect in this process, without a real model."""

from __future__ import annotations

import gc
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import pytest

if TYPE_CHECKING:
    from inspect_ai import Task
    from inspect_ai.log import EvalLog
    from inspect_ai.model import ChatMessage

Answer = Callable[[list["ChatMessage"]], Any]


class Evaluate(Protocol):
    def __call__(self, task: Task, answer: Answer, **more: Any) -> EvalLog: ...


@pytest.fixture
def evaluate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Evaluate:
    """Evaluate a task with a model that answers with a function's text or `ModelOutput`."""
    from inspect_ai import eval as inspect_eval
    from inspect_ai.model import ModelOutput, ModelUsage, get_model

    monkeypatch.setenv("INSPECT_DISPLAY", "none")

    def evaluate(task: Task, answer: Answer, **more: Any) -> EvalLog:
        def output(messages: list[ChatMessage], *_: object) -> ModelOutput:
            said = answer(messages)
            if isinstance(said, ModelOutput):
                return said
            found = ModelOutput.from_content("mockllm", said)
            # Without it Inspect would count tokens, for which it fetches a tokenizer.
            found.usage = ModelUsage(input_tokens=10, output_tokens=5, total_tokens=15)
            return found

        model = get_model("mockllm/model", custom_outputs=output)
        with warnings.catch_warnings():
            # Inspect's own: of the library with which it retries, and a stream that it leaves open.
            warnings.filterwarnings("ignore", "The 'initial' parameter", DeprecationWarning)
            warnings.filterwarnings("ignore", "Unclosed <MemoryObject", ResourceWarning)
            (log,) = inspect_eval(task, model=model, log_dir=str(tmp_path / "logs"), **more)
            gc.collect()
        return log

    return evaluate
