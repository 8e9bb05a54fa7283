"""Calls of models that were paid for, kept as soon as they are answered.

A run that was killed plays its episodes again, and is answered from here as long as it asks the
same: strategies are deterministic, so it does.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import asdict
from io import FileIO
from pathlib import Path
from types import TracebackType

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille_evaluation.agents.asking import Complete
from robotouille_evaluation.agents.proposal import ContextOverflow
from robotouille_evaluation.models import (
    Completion,
    Model,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    Usage,
)
from robotouille_evaluation.runs.appending import append_line

__all__ = ["CallJournal", "asking_once"]

OVERFLOW = "overflow"
MAX_TOKENS = 10**12
"""Of one call; a file that says more was not written here."""


class _Call(BaseModel):
    """A line of the file: what was asked, as a hash, and the answer or that it was too long."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    request: str
    overflow: bool = False
    completion: Completion | None = None

    @model_validator(mode="after")
    def _is_possible(self) -> _Call:
        if self.overflow != (self.completion is None):
            raise ValueError("is neither answered nor too long")
        if self.completion is not None:
            usage, seconds = self.completion.usage, self.completion.seconds
            counts = (usage.prompt_tokens, usage.completion_tokens, self.completion.attempts)
            if not all(0 <= count <= MAX_TOKENS for count in counts):
                raise ValueError("has counts that no call has")
            if not math.isfinite(seconds + (usage.cost or 0)):
                raise ValueError("has no finite numbers")
        return self

    def line(self) -> bytes:
        """As it is written."""
        row: dict[str, object] = {"request": self.request}
        if self.completion is None:
            row["overflow"] = True
        else:
            row["completion"] = asdict(self.completion)
        return json.dumps(row, ensure_ascii=False).encode() + b"\n"


class CallJournal:
    """The calls of one episode, in their order, in a file of JSON lines.

    Raises:
        FileError: The file cannot be read or written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._next = 0
        self._file: FileIO | None = None
        self._kept: list[_Call] = []
        self._kept = self._read()

    def __enter__(self) -> CallJournal:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def answered(self, request: ModelRequest) -> Completion | str | None:
        """What this request was answered; `overflow` where it was too long; None if nobody asked.

        What is kept behind a request that differs belongs to another course, and is dropped.
        """
        if self._next >= len(self._kept):
            return None
        call = self._kept[self._next]
        if call.request != digest(request):
            del self._kept[self._next :]
            self._rewrite()
            return None
        self._next += 1
        return call.completion or OVERFLOW

    def keep(self, request: ModelRequest, completion: Completion | None) -> None:
        """An answer, or None where the request was too long; it is on the disk afterwards."""
        call = _Call.model_construct(
            request=digest(request), overflow=completion is None, completion=completion
        )
        self._kept.append(call)
        self._next = len(self._kept)
        try:
            if self._file is None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                self._file = FileIO(self._path, "ab")
            append_line(self._file, call.line())
        except OSError as error:
            raise self._unwritable(error) from None

    def close(self) -> None:
        """No more calls."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _read(self) -> list[_Call]:
        try:
            content = self._path.read_bytes()
        except FileNotFoundError:
            return []
        except OSError as error:
            fault = Fault("", f"cannot be read: {error.strerror}")
            raise FileError(str(self._path), [fault]) from None
        calls = []
        whole = content[: content.rfind(b"\n") + 1]
        for number, line in enumerate(whole.split(b"\n")[:-1], start=1):
            try:
                calls.append(_Call.model_validate_json(line, strict=True))
            except ValidationError:
                raise FileError(
                    str(self._path), [Fault(f"line {number}", "is no call of a model")]
                ) from None
        if whole != content:
            self._kept = calls
            self._rewrite()
        return calls

    def _rewrite(self) -> None:
        self.close()
        beside = self._path.with_suffix(".new")
        try:
            beside.write_bytes(b"".join(call.line() for call in self._kept))
            beside.replace(self._path)
        except OSError as error:
            raise self._unwritable(error) from None

    def _unwritable(self, error: OSError) -> FileError:
        return FileError(str(self._path), [Fault("", f"cannot be written: {error.strerror}")])


def digest(request: ModelRequest) -> str:
    """What is asked, as a hash."""
    content = [[(m.role, m.content) for m in request.messages], dict(request.parameters)]
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def asking_once(
    model: Model | None, journal: CallJournal, spend: Callable[[Usage], None]
) -> Complete:
    """Asks a model for what the journal does not know; `spend` is told what each call has cost."""

    async def complete(request: ModelRequest) -> Completion:
        kept = journal.answered(request)
        if kept == OVERFLOW:
            raise ContextOverflow
        if isinstance(kept, Completion):
            spend(kept.usage)
            return kept
        if model is None:
            raise RobotouilleError("this agent asks a model, and there is none")
        try:
            completion = await model.complete(request)
        except ModelError as error:
            spend(error.usage)
            if error.kind is ModelErrorKind.CONTEXT_OVERFLOW:
                journal.keep(request, None)
                raise ContextOverflow from None
            if error.kind not in (ModelErrorKind.EMPTY, ModelErrorKind.TOO_LONG):
                raise
            completion = Completion(
                "", error.usage, finish_reason=error.kind.value, attempts=error.attempts
            )
        else:
            spend(completion.usage)
        journal.keep(request, completion)
        return completion

    return complete
