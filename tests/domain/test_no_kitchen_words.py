"""The code knows nothing about cooking: dishes, stations and actions are defined in files.

The exception is `planning/kitchen`, which speeds up planning in domains like the shipped one.
"""

import ast
import json
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted(
    path
    for folder in ("shared", "server", "client")
    for path in (ROOT / folder).rglob("*.py")
    if "planning/kitchen" not in path.as_posix()
)

KITCHEN = json.loads((ROOT / "domains/robotouille.json").read_text())
DEFINITIONS = (*KITCHEN["predicate_defs"], *KITCHEN["action_defs"])
NAMES = [d["name"] for d in DEFINITIONS if re.match("is|.*[-_]", d["name"])]
# Food, tools and what people do with them.
STEMS = re.compile(
    "stove|fryer|lettuce|patty|bread|cheese|chicken|tomato|onion|potato|water|topbun|bottombun"
    "|cook|boil|fries|fried|soup|burger|sandwich|recipe|knife|trestle|anvil|dispens|bolt|offcut"
    rf"|(?<![a-z_-])(?:{'|'.join(NAMES)})(?![a-z_-])"
)

# The default task of a server is a setting.
ALLOWED = {("settings.py", "lettuce"), ("settings.py", "burger")}


def code_of(path: Path) -> list[str]:
    """Return the lines of code of a file, without comments and docstrings."""
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            node.value.value = ""
    return ast.unparse(tree).splitlines()


def test_no_kitchen_words() -> None:
    found = {
        (str(path.relative_to(ROOT)), text, word)
        for path in SOURCES
        if STEMS.search(path.read_text().lower())
        for text in code_of(path)
        for word in STEMS.findall(text.lower())
        if (path.name, word) not in ALLOWED
    }
    assert sorted(found) == []
