"""Calls of models that were paid for, kept as soon as they are answered.

A run that was killed plays its episodes again, and is answered from here as long as it asks the
same: strategies are deterministic, so it does.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Any

from robotouille.errors import Fault, FileError
from robotouille_evaluation.models.model import Completion, ModelRequest, Usage
from robotouille_evaluation.runs.appending import append_line

__all__ = ["CallJournal"]

OVERFLOW = "overflow"


class CallJournal:
    """The calls of one episode, in their order, in a file of JSON lines.

    Raises:
        FileError: The file cannot be read or written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._next = 0
        self._file: FileIO | None = None
        self._kept: list[dict[str, Any]] = []
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

    @property
    def kept(self) -> int:
        """Calls that need not be made again."""
        return len(self._kept)

    def answered(self, request: ModelRequest) -> Completion | str | None:
        """What this request was answered; `overflow` where it was too long; None if nobody asked.

        What is kept behind a request that differs belongs to another course, and is dropped.
        """
        if self._next >= len(self._kept):
            return None
        call = self._kept[self._next]
        if call["request"] != digest(request):
            del self._kept[self._next :]
            self._rewrite()
            return None
        self._next += 1
        if call.get("overflow"):
            return OVERFLOW
        return _completion(call)

    def keep(self, request: ModelRequest, completion: Completion | None) -> None:
        """An answer, or None where the request was too long; it is on the disk afterwards."""
        call: dict[str, Any] = {"request": digest(request)}
        if completion is None:
            call["overflow"] = True
        else:
            call["completion"] = asdict(completion)
        self._kept.append(call)
        self._next = len(self._kept)
        try:
            if self._file is None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                self._file = FileIO(self._path, "ab")
            append_line(self._file, _line(call))
        except OSError as error:
            raise self._unwritable(error) from None

    def close(self) -> None:
        """No more calls."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _read(self) -> list[dict[str, Any]]:
        try:
            content = self._path.read_bytes()
        except FileNotFoundError:
            return []
        except OSError as error:
            fault = Fault("", f"cannot be read: {error.strerror}")
            raise FileError(str(self._path), [fault]) from None
        calls = []
        whole = content[: content.rfind(b"\n") + 1]
        for number, line in enumerate(whole.splitlines(), start=1):
            try:
                call = json.loads(line)
                if not isinstance(call["request"], str):
                    raise TypeError
                if not call.get("overflow"):
                    _completion(call)
            except (ValueError, TypeError, KeyError):
                raise FileError(
                    str(self._path), [Fault(f"line {number}", "is no call of a model")]
                ) from None
            calls.append(call)
        if whole != content:
            self._kept = calls
            self._rewrite()
        return calls

    def _rewrite(self) -> None:
        self.close()
        beside = self._path.with_suffix(".new")
        try:
            beside.write_bytes(b"".join(map(_line, self._kept)))
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


def _completion(call: dict[str, Any]) -> Completion:
    answer = call["completion"]
    return Completion(**{**answer, "usage": Usage(**answer["usage"])})


def _line(call: dict[str, Any]) -> bytes:
    return json.dumps(call, ensure_ascii=False).encode() + b"\n"
