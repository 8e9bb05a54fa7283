"""Nothing in Python knows about cooking: a dish, a station or an action is a matter of files.

One plug-in does (`planners/kitchen`): it makes domains that say the same as the shipped one fast to
plan in, and the general planner takes all others.
"""

import ast
import io
import json
import re
import tokenize
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted(
    path
    for folder in ("shared", "server", "client")
    for path in (ROOT / folder).rglob("*.py")
    if "planners" not in path.parts
)

# Food, tools and what is done with them.
STEMS = re.compile(
    "stove|fryer|lettuce|patty|bread|cheese|chicken|tomato|onion|potato|water|topbun|bottombun"
    "|cook|boil|fries|fried|soup|burger|sandwich|recipe|knife|trestle|anvil|dispens|bolt|offcut"
)

# The task a server opens unless told otherwise is a setting.
ALLOWED = {("settings.py", "lettuce"), ("settings.py", "burger")}


def names_of_the_domains() -> set[str]:
    """Predicates and actions of the shipped domains that are no everyday words."""
    found = set()
    for name in ("robotouille", "workshop"):
        domain = json.loads((ROOT / "domains" / f"{name}.json").read_text())
        for definition in (*domain["predicate_defs"], *domain["action_defs"]):
            found.add(definition["name"])
    return {name for name in found if re.match("is|.*[-_]", name)}


# From Python 3.12 on, the text of an f-string is a token of its own.
TOKENS = {tokenize.NAME, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING)}
NAMES = names_of_the_domains()


def code_of(path: Path) -> list[tuple[int, str]]:
    """Each name and text of a source file with its line, without comments and docstrings."""
    source = path.read_text()
    if not kitchen_words(source):
        return []
    documentation = {
        line
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
        for line in range(node.lineno, (node.end_lineno or 0) + 1)
    }
    return [
        (token.start[0], token.string)
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type in TOKENS and token.start[0] not in documentation
    ]


def kitchen_words(text: str) -> set[str]:
    names = {part for part in re.split(r"[^a-z_-]+", text.lower()) if part in NAMES}
    return names | set(STEMS.findall(text.lower()))


def test_no_kitchen_words() -> None:
    found = {
        (str(path.relative_to(ROOT)), line, word)
        for path in SOURCES
        for line, text in code_of(path)
        for word in kitchen_words(text)
        if (path.name, word) not in ALLOWED
    }
    assert sorted(found) == []


def test_the_search_finds_what_it_should(tmp_path: Path) -> None:
    path = tmp_path / "source.py"
    path.write_text('"""A pot."""\nif name == "iscut":  # lettuce\n    stoves = "a patty"\n')
    found = [kitchen_words(text) for _, text in code_of(path)]
    assert {word for words in found for word in words} == {"iscut", "stove", "patty"}
