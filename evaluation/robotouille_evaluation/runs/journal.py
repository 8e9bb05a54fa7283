"""Journal of paid model calls, written as soon as each call is answered.

A run that was killed plays its episodes again. The journal answers the same requests, so no call is
paid for twice. Strategies are deterministic, so they do make the same requests.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import IO

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille.files.reading import open_regular
from robotouille.files.writing import open_own
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
MAX_LINE_BYTES = 8 << 20
"""Bytes of a line. JSON has up to six bytes for each of the `MAX_ANSWER_BYTES` of an answer."""
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

    Recorded calls are read one at a time: a run may come from anyone, and its files may be long.

    Raises:
        FileError: The file cannot be read or written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._line = self._end = 0
        """Number of the last answered call, and the offset of the next one."""
        self._file: FileIO | None = None
        self._recorded: IO[bytes] | None = None
        with suppress(FileNotFoundError), self._reading():
            self._recorded = open_regular(path)

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
        line = self._next_line()
        if line.endswith(b"\n"):
            try:
                call = _Call.model_validate_json(line, strict=True)
            except ValidationError:
                raise self._fault("not a model call") from None
            # For example, the strategy was changed between two plays.
            if call.request == digest(request):
                self._line, self._end = self._line + 1, self._end + len(line)
                return call.completion or OVERFLOW
        self._drop_rest()
        return None

    def keep(self, request: ModelRequest, completion: Completion | None) -> None:
        """Record an answer, or None for a too long request, and return when it is on the disk."""
        self._drop_rest()
        # The values are not validated, because they were made here and validation costs time.
        call = _Call.model_construct(
            request=digest(request), overflow=completion is None, completion=completion
        )
        with self._writing() as file:
            append_line(file, call.line())

    def close(self) -> None:
        """Close the file."""
        for file in (self._file, self._recorded):
            if file is not None:
                file.close()
        self._file = self._recorded = None

    def _next_line(self) -> bytes:
        """Return the line of the next call, which a kill may have truncated; empty at the end."""
        if self._recorded is None:
            return b""
        with self._reading():
            line = self._recorded.readline(MAX_LINE_BYTES + 1)
        if len(line) > MAX_LINE_BYTES:
            raise self._fault(f"is longer than {MAX_LINE_BYTES:,} bytes")
        return line

    def _drop_rest(self) -> None:
        """Truncate the file after the last answered call."""
        if self._recorded is None:
            return
        self._recorded.close()
        self._recorded = None
        with self._writing() as file:
            file.truncate(self._end)

    @contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except FileNotFoundError:
            raise
        except OSError as error:
            fault = Fault("", f"cannot be read: {error.strerror}")
            raise FileError(str(self._path), [fault]) from None

    @contextmanager
    def _writing(self) -> Iterator[FileIO]:
        try:
            if self._file is None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                self._file = FileIO(self._path, "ab", opener=open_own)
            yield self._file
        except OSError as error:
            fault = Fault("", f"cannot be written: {error.strerror}")
            raise FileError(str(self._path), [fault]) from None

    def _fault(self, what: str) -> FileError:
        return FileError(str(self._path), [Fault(f"line {self._line + 1}", what)])


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
