"""Journal of paid model calls, written as soon as each call is answered.

A run that was killed plays its episodes again. The journal answers the same requests, so no call is
paid for twice. Strategies are deterministic, so they do make the same requests.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from io import FileIO
from pathlib import Path
from types import TracebackType

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille.files.reading import read_bytes
from robotouille.files.writing import open_own, replace_file
from robotouille_evaluation.agents.proposal import Complete, ContextOverflow
from robotouille_evaluation.models import (
    Completion,
    Model,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    Usage,
)
from robotouille_evaluation.models.model import NOTHING


def append_line(file: FileIO, line: bytes) -> None:
    """Append a line and return when it is on the disk.

    Args:
        file: File opened for appending, without a buffer.

    Raises:
        OSError: The line cannot be written; the file has its old length again.
    """
    # A transcript may be a pipe, which has no length and needs no fsync.
    size = file.seek(0, os.SEEK_END) if file.seekable() else None
    try:
        rest = memoryview(line)
        while rest:
            rest = rest[file.write(rest) :]
        if size is not None:
            os.fsync(file.fileno())
    except OSError:
        # A full disk accepts part of a line. Truncation keeps the file readable.
        with suppress(OSError):
            if size is not None:
                file.truncate(size)
        raise


OVERFLOW = "overflow"
MAX_BYTES = 1 << 29
"""Bytes of a file."""
MAX_TOKENS = 10**12
"""Most tokens of one call. Larger numbers show that the file is damaged."""


class _Call(BaseModel):
    """Line of the file: the hash of a request, and its completion or that it was too long."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    request: str
    overflow: bool = False
    completion: Completion | None = None

    @model_validator(mode="after")
    def _is_possible(self) -> _Call:
        if self.overflow != (self.completion is None):
            raise ValueError("expected either a completion or an overflow")
        if self.completion is not None:
            usage, seconds = self.completion.usage, self.completion.seconds
            counts = (usage.prompt_tokens, usage.completion_tokens, self.completion.attempts)
            if not all(0 <= count <= MAX_TOKENS for count in counts):
                raise ValueError("the counts are out of range")
            if not math.isfinite(seconds + (usage.cost or 0)):
                raise ValueError("the numbers are not finite")
        return self

    def line(self) -> bytes:
        row: dict[str, object] = {"request": self.request}
        if self.completion is None:
            row["overflow"] = True
        else:
            row["completion"] = asdict(self.completion)
        return json.dumps(row, ensure_ascii=False).encode() + b"\n"


class CallJournal:
    """Calls of one player in an episode, in order, in a file of JSON lines.

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
        """Return the recorded answer to the next request, or `OVERFLOW`, or None.

        If the request differs from the recorded one, the rest of the journal belongs to another
        course of the episode and is dropped.
        """
        if self._next >= len(self._kept):
            return None
        call = self._kept[self._next]
        # For example, the strategy was changed between two plays.
        if call.request != digest(request):
            del self._kept[self._next :]
            self._rewrite()
            return None
        self._next += 1
        return call.completion or OVERFLOW

    def keep(self, request: ModelRequest, completion: Completion | None) -> None:
        """Record an answer, or None for a too long request, and return when it is on the disk."""
        # The values are not validated, because they were made here and validation costs time.
        call = _Call.model_construct(
            request=digest(request), overflow=completion is None, completion=completion
        )
        self._kept.append(call)
        self._next = len(self._kept)
        try:
            if self._file is None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                self._file = FileIO(self._path, "ab", opener=open_own)
            append_line(self._file, call.line())
        except OSError as error:
            raise self._unwritable(error) from None

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _read(self) -> list[_Call]:
        try:
            content = read_bytes(self._path, MAX_BYTES)
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
                    str(self._path), [Fault(f"line {number}", "not a model call")]
                ) from None
        if whole != content:
            self._kept = calls
            self._rewrite()
        return calls

    def _rewrite(self) -> None:
        self.close()
        try:
            replace_file(self._path, b"".join(call.line() for call in self._kept))
        except OSError as error:
            raise self._unwritable(error) from None

    def _unwritable(self, error: OSError) -> FileError:
        return FileError(str(self._path), [Fault("", f"cannot be written: {error.strerror}")])


def digest(request: ModelRequest) -> str:
    """Return a hash of messages and parameters."""
    content = [[(m.role, m.content) for m in request.messages], dict(request.parameters)]
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def asking_once(
    model: Model | None, journal: CallJournal, spend: Callable[[Usage, int], None]
) -> Complete:
    """Return a function that asks the model only for answers missing in the journal.

    Args:
        spend: Called with the usage and number of attempts of each call, also of recorded ones.
    """

    async def complete(request: ModelRequest) -> Completion:
        kept = journal.answered(request)
        if kept == OVERFLOW:
            spend(NOTHING, 1)
            raise ContextOverflow
        if isinstance(kept, Completion):
            spend(kept.usage, kept.attempts)
            return kept
        if model is None:
            raise RobotouilleError("this agent needs a model, and none is configured")
        try:
            completion = await model.complete(request)
        except ModelError as error:
            spend(error.usage, error.attempts)
            if error.kind is ModelErrorKind.CONTEXT_OVERFLOW:
                journal.keep(request, None)
                raise ContextOverflow from None
            if error.kind is not ModelErrorKind.EMPTY:
                raise
            # An empty answer was paid for, so it is kept like any other.
            completion = Completion(
                "", error.usage, finish_reason=error.kind.value, attempts=error.attempts
            )
        else:
            spend(completion.usage, completion.attempts)
        journal.keep(request, completion)
        return completion

    return complete
