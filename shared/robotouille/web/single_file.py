"""Pages in a single file, which browsers open from disk without a server.

Browsers refuse to import a module next to a page that was opened from disk. The page therefore
contains all its modules. A script in it adds an import map, in which each module is a `data:` URL
under a name without a path, and then imports the first one.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import posixpath
import re
from pathlib import Path
from typing import Any

from robotouille.web.site import STATIC, without_comments

PREFIX = "robotouille/"
"""Beginning of a module's name in an import map, before its path."""
LINE = 4096
"""Characters in a line of base64. Editors become slow at lines of a megabyte."""

_IMPORT = re.compile(
    r"""^((?:import|export)\s(?:[^"';]*?\sfrom\s+)?)(["'])(\.{1,2}/[^"'\n]+)\2""", re.MULTILINE
)
"""Import of a relative path, in a statement at the start of a line."""


def with_bare_imports(name: str, source: str) -> tuple[str, list[str]]:
    """Return a module whose relative imports have names of an import map, and the imported paths.

    Only statements at the start of a line are imports. Types in comments, such as
    `import("./task.js").Task`, stay as they are.

    Args:
        name: Path of the module in its folder, such as `play/main.js`.

    Raises:
        ValueError: An import leads out of the folder.
    """
    found: list[str] = []

    def renamed(match: re.Match[str]) -> str:
        statement, quote, path = match.groups()
        target = posixpath.normpath(posixpath.join(posixpath.dirname(name), path))
        if target.startswith(".."):
            raise ValueError(f"{name} imports {path}, which is outside the folder")
        found.append(target)
        return f"{statement}{quote}{PREFIX}{target}{quote}"

    return _IMPORT.sub(renamed, source), found


def modules_of(entry: str, folder: Path = STATIC) -> dict[str, str]:
    """Return a module and everything that it imports, by path, with names of an import map.

    Raises:
        ValueError: An import leads out of the folder.
        OSError: A module cannot be read.
    """
    found: dict[str, str] = {}
    waiting = [entry]
    while waiting:
        name = waiting.pop()
        if name not in found:
            source = without_comments((folder / name).read_bytes())
            found[name], imported = with_bare_imports(name, source.decode())
            waiting += imported
    return dict(sorted(found.items()))


def import_map(modules: dict[str, str]) -> str:
    """Return an import map with modules as `data:` URLs."""
    urls = {
        f"{PREFIX}{name}": f"data:text/javascript;base64,{_base64(source.encode())}"
        for name, source in modules.items()
    }
    return json.dumps({"imports": urls}, separators=(",", ":"))


def single_file(entry: str, page: str, styles: list[str], data: Any) -> str:
    """Return a page with its modules, styles and data, which can connect to nothing.

    The page receives nothing but base64 and files of this package, so texts in the data cannot
    become markup.

    Args:
        entry: The first module. It exports `start`, which receives the data.
        page: HTML with the places `{policy}`, `{style}`, `{boot}`, `{modules}` and `{data}`.
        styles: Style sheets, in order.
        data: JSON values.
    """
    imports = import_map(modules_of(entry))
    boot = (STATIC / "replay/boot.js").read_text(encoding="utf-8").replace("{entry}", entry)
    style = "\n".join((STATIC / name).read_text(encoding="utf-8") for name in styles)
    policy = "; ".join(
        (
            "default-src 'none'",
            # The browser checks the import map like a script.
            f"script-src {_digest(boot)} {_digest(imports)} data:",
            f"style-src {_digest(style)}",
            "img-src data: blob:",
            "connect-src 'none'",
            "base-uri 'none'",
            "form-action 'none'",
        )
    )
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"))
    parts = {
        "policy": policy,
        "style": style,
        "boot": boot,
        "modules": packed(imports.encode()),
        # Recordings may contain lone surrogates.
        "data": packed(text.encode("utf-8", "replace")),
    }
    return re.sub(r"\{(\w+)\}", lambda match: parts[match[1]], page)


def packed(content: bytes) -> str:
    """Return content as lines of base64, compressed with gzip."""
    # Without a time, equal pages are equal files.
    text = _base64(gzip.compress(content, 9, mtime=0))
    return "\n".join(text[at : at + LINE] for at in range(0, len(text), LINE))


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()


def _digest(text: str) -> str:
    return f"'sha256-{_base64(hashlib.sha256(text.encode()).digest())}'"
