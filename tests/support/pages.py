"""Documentation pages with their code blocks and links."""

import re
from pathlib import Path
from textwrap import dedent

from tests.support.sources import ROOT

DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))

_BLOCK = re.compile(
    r"^( *)```(\w+)(?: title=\"([^\"]*)\")?\n(.*?)^\1```$", re.DOTALL | re.MULTILINE
)
_ANY_BLOCK = re.compile(r"```.*?```", re.DOTALL)
_LINK = re.compile(r"(?<!!)\[[^\]]*\]\(([^)\s]+)\)")


def read(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def blocks(name: str, language: str) -> list[str]:
    """Return the untitled code blocks of a page in one language."""
    return [
        dedent(text)
        for _, lang, title, text in _BLOCK.findall(read(name))
        if lang == language and not title
    ]


def titled(name: str, title: str) -> str:
    """Return a page's code block with this title."""
    (found,) = [text for _, _, given, text in _BLOCK.findall(read(name)) if given == title]
    return dedent(found)


def prose(page: Path) -> str:
    return _ANY_BLOCK.sub("", page.read_text(encoding="utf-8"))


def links(page: Path) -> list[str]:
    return _LINK.findall(prose(page))


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub generates them."""
    found = set()
    for heading in re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE):
        slug = re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
        found.add(slug)
    return found


def table(name: str, heading: str) -> list[list[str]]:
    """Return the rows of the first table under a heading."""
    section = read(name).split(f"\n## {heading}\n")[1].split("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip(" `") for cell in row.strip("|").split("|")] for row in rows[2:]]
