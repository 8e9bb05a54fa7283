"""Pages in a single file, which browsers open from disk without a server.

Browsers refuse to import a module next to a page that was opened from disk. The page therefore
contains all its modules as one, compressed, and a script that imports it from a `data:` URL.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re
import secrets
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from io import BytesIO
from typing import Any, overload

from robotouille.web.site import STATIC, bundled_module

LINE = 4096
"""Characters in a line of base64. Editors become slow at lines of a megabyte."""


class JsonRows(Sequence[Any]):
    """Rows that are kept as JSON text, which takes a fraction of the memory of Python objects.

    Args:
        rows: The first rows.
        charge: Called with the bytes of memory of each row.
    """

    def __init__(
        self, rows: Iterable[Any] = (), charge: Callable[[int], None] = lambda size: None
    ) -> None:
        self._charge = charge
        self._texts: list[str] = []
        for row in rows:
            self.append(row)

    def append(self, row: Any) -> None:
        """Add a row."""
        text = _compact(row)
        self._charge(sys.getsizeof(text))
        self._texts.append(text)

    def cut(self, length: int) -> None:
        """Keep only the first rows."""
        del self._texts[length:]

    def write(self, file: BytesIO) -> None:
        """Write the rows as a JSON array."""
        file.write(b"[")
        for number, text in enumerate(self._texts):
            file.write(_utf8(f",{text}" if number else text))
        file.write(b"]")

    def __len__(self) -> int:
        return len(self._texts)

    @overload
    def __getitem__(self, place: int) -> Any: ...

    @overload
    def __getitem__(self, place: slice) -> list[Any]: ...

    def __getitem__(self, place: int | slice) -> Any:
        if isinstance(place, slice):
            return [json.loads(text) for text in self._texts[place]]
        return json.loads(self._texts[place])


def single_file(entry: str, page: str, styles: list[str], data: Any) -> str:
    """Return a page with its modules, styles and data, which can connect to nothing.

    The page receives nothing but base64 and files of this package, so texts in the data cannot
    become markup.

    Args:
        entry: The first module. It exports `start`, which receives the data.
        page: HTML with the places `{head}` and `{end}`.
        styles: Style sheets, in order.
        data: JSON values.
    """
    boot = (STATIC / "replay/boot.js").read_text(encoding="utf-8")
    style = "\n".join((STATIC / name).read_text(encoding="utf-8") for name in styles)
    policy = "; ".join(
        (
            "default-src 'none'",
            f"script-src {_digest(boot)} data:",
            f"style-src {_digest(style)}",
            "img-src data: blob:",
            "connect-src 'none'",
            "base-uri 'none'",
            "form-action 'none'",
        )
    )
    modules = _packed_modules(entry)
    content = packed(encoded(data))
    return filled(
        page,
        head=f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        f"    <style>{style}</style>",
        end=f'<script type="application/octet-stream" id="modules">{modules}</script>\n'
        f'    <script type="application/octet-stream" id="data">{content}</script>\n'
        f"    <script>{boot}</script>",
    )


@cache
def _packed_modules(entry: str) -> str:
    return packed(bundled_module(entry))


def filled(page: str, **parts: str) -> str:
    """Return HTML with parts in place of their names in braces."""
    return re.sub(r"\{(\w+)\}", lambda match: parts[match[1]], page)


def encoded(data: Any) -> bytes:
    """Return JSON values as compact text. Some of them may be `JsonRows`."""
    found: list[JsonRows] = []
    # No text of a participant contains this word.
    word = secrets.token_hex(16)

    def place(value: Any) -> str:
        if not isinstance(value, JsonRows):
            raise TypeError(f"not a JSON value: {type(value).__name__}")
        found.append(value)
        return f"{word}{len(found) - 1}"

    pieces = re.split(rf'"{word}(\d+)"', _compact(data, place))
    file = BytesIO()
    for number, piece in enumerate(pieces):
        if number % 2:
            found[int(piece)].write(file)
        else:
            file.write(_utf8(piece))
    return file.getvalue()


def _utf8(text: str) -> bytes:
    return text.encode("utf-8", "replace")  # Recordings may contain lone surrogates.


def _compact(value: Any, default: Callable[[Any], Any] | None = None) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"), default=default)


def packed(content: bytes) -> str:
    """Return content as lines of base64, compressed with gzip."""
    # Without a time, equal pages are equal files.
    text = _base64(gzip.compress(content, 9, mtime=0))
    return "\n".join(text[at : at + LINE] for at in range(0, len(text), LINE))


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()


def _digest(text: str) -> str:
    return f"'sha256-{_base64(hashlib.sha256(text.encode()).digest())}'"
