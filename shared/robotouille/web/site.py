"""Files of the browser client, addressed by their content.

Browsers keep a file for ever, because its address changes with the content of any file. Only the
first page has a fixed address.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial
from html import escape
from pathlib import Path, PurePosixPath
from typing import Any

from robotouille.domain.input_bindings import domain_bindings
from robotouille.domain.related_files import read_extending, rendering_path
from robotouille.domain.rendering import RENDERING_FILES, RenderingFile
from robotouille.domain.schema import InputFile
from robotouille.domain.task import read_domain
from robotouille.installation import data_folder
from robotouille.web.bundle import bundle

STATIC = Path(__file__).parent / "static"
PAGE = "index.html"
ENTRY, BUNDLE = "play/main.js", "play/bundle.js"
DEFAULTS = "published_defaults"
"""File in the folder of the domains that is not a domain."""
REPLAY = "replay"
"""Folder of the page for recordings, which is written to files and not served."""
KINDS = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".svg": "image/svg+xml",
}
"""Types of the files that are served. Other files in the folder are not."""


@dataclass(frozen=True, slots=True)
class WebFile:
    """File of the site.

    Attributes:
        kind: Value of `Content-Type`.
        content: The file.
        packed: The file, compressed with gzip.
    """

    kind: str
    content: bytes
    packed: bytes

    @classmethod
    def of(cls, name: str, content: bytes) -> WebFile:
        """Return a file, with the type that its name ends with."""
        kind = KINDS[PurePosixPath(name).suffix]
        # Without a time, equal files have equal archives. The highest level takes twice the time
        # and saves 1 %; the server compresses a file between two steps.
        return cls(kind, content, gzip.compress(content, 6, mtime=0))


class WebSite:
    """Files of the browser client.

    `play/bundle.js` has all modules that the page needs. They are also there one by one.

    `looks/NAME.json` has the rendering and the key bindings of the shipped domain NAME, and
    `pictures/FOLDER.json` all SVG pictures of a folder of `assets`, by their file names. One
    compressed file of pictures is a tenth of the size of the pictures, and needs one request.

    Attributes:
        version: Digest of all files, part of their addresses.
    """

    def __init__(self, folder: Path = STATIC) -> None:
        # The bytes behind the digest are kept: a file that is changed later must not be served
        # under the address of the old one.
        self._contents = dict(_files(folder))
        self._made: dict[str, WebFile] = {}
        self.version = self._digest()

    @property
    def names(self) -> list[str]:
        """Names of all files, sorted."""
        return sorted(self._contents)

    def page(self, consent: str = "") -> WebFile:
        """Return the first page, with the addresses of its files.

        Args:
            consent: Address of the information to which people agree before they play.
        """
        text = self._contents[PAGE].decode().replace("{files}", f"play/{self.version}")
        return WebFile.of(PAGE, text.replace("{consent}", escape(consent)).encode())

    def find(self, name: str) -> WebFile | None:
        """Return a file by its name, such as `play/main.js`; None if it does not exist."""
        content = self._contents.get(name)
        if content is not None and name not in self._made:
            self._made[name] = WebFile.of(name, content)
        return self._made.get(name)

    def _digest(self) -> str:
        found = hashlib.sha256()
        for name, content in sorted(self._contents.items()):
            found.update(f"{name} {len(content)}\n".encode())
            found.update(content)
        return found.hexdigest()[:16]


@cache
def shared_site() -> WebSite:
    """Return the site of this process. Reading all files takes 50 ms."""
    return WebSite()


def _files(folder: Path) -> Iterator[tuple[str, bytes]]:
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        if path.suffix in KINDS and name.parts[0] != REPLAY:
            content = path.read_bytes()
            yield name.as_posix(), without_comments(content) if path.suffix == ".js" else content
    if (folder / ENTRY).is_file():
        yield BUNDLE, bundle(ENTRY, partial(module_text, folder=folder)).encode()
    for domain in _shipped_domains():
        yield f"looks/{domain}.json", _shipped_look(domain)
    for path in sorted(data_folder("assets").iterdir()):
        if path.is_dir() and any(path.glob("*.svg")):
            yield f"pictures/{path.name}.json", _pictures(path)


_COMMENT = re.compile(rb"(?ms)^[ \t]*(?:/\*\*(?:(?!\*/).)*\*/[ \t]*|//[^\n]*)\n")


def without_comments(script: bytes) -> bytes:
    """Return a module without comments that have lines of their own, a third of its size.

    Modules have no strings with such lines.
    """
    return _COMMENT.sub(b"", script)


def module_text(name: str, folder: Path = STATIC) -> str:
    """Return a module without comments by its name, such as `play/main.js`."""
    return without_comments((folder / name).read_bytes()).decode()


@cache
def bundled_module(entry: str) -> bytes:
    """Return a module with all modules that it imports as one; the first call takes 25 ms."""
    return bundle(entry, module_text).encode()


def _shipped_domains() -> Iterator[str]:
    """Yield the names of the shipped domains. Names with a dot are those of input files."""
    for path in sorted(data_folder("domains").glob("*.json")):
        if "." not in path.stem and path.stem != DEFAULTS:
            yield path.stem


def _shipped_look(name: str) -> bytes:
    domain = read_domain(name)
    rendering = read_extending(rendering_path(domain, None), RENDERING_FILES)
    return _packed(look_files(rendering, domain_bindings(domain)))


def look_files(rendering: RenderingFile, bindings: InputFile) -> dict[str, Any]:
    """Return a rendering and key bindings as the page reads them."""
    return {
        "rendering": rendering.model_dump(mode="json", by_alias=True, exclude_defaults=True),
        "bindings": bindings.model_dump(mode="json", by_alias=True, exclude_defaults=True),
    }


def _pictures(folder: Path) -> bytes:
    return _packed({path.name: path.read_text() for path in sorted(folder.glob("*.svg"))})


def _packed(value: Any) -> bytes:
    # The order of the pictures in a rendering decides between equally specific ones.
    return json.dumps(value, separators=(",", ":")).encode()
