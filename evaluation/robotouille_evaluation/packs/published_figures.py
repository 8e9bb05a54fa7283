"""Numbers behind the paper's figures, read from the notebook of a checkout.

The notebook is JSON, and its cells assign literals to variables. It is never executed: each literal
is cut out of its cell token by token, so that only brackets, texts and numbers reach
`ast.literal_eval`, and only few of them.
"""

from __future__ import annotations

import ast
import io
import json
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

from robotouille.domain.json_files import MAX_VALUES, weight
from robotouille.errors import Fault, FileError
from robotouille.files.reading import open_regular
from robotouille_evaluation.packs.pack import FigureData
from robotouille_evaluation.packs.published_configuration import require_inside

NOTEBOOK = "figures.ipynb"
REACT = "gpt-4o, ReAct"
"""Player of the published results that reports show."""
SUCCESSES, FAILURES = "successes", "failures"

MAX_NOTEBOOK_BYTES = 32 * 1024 * 1024
"""A notebook contains its pictures."""
MAX_CELL = 100_000
"""Characters of a cell that is read."""
MAX_TOKENS = 20_000
MAX_DEPTH = 5
"""Most tokens and brackets within brackets of a literal."""

SAMPLES = {
    "synchronous_optimality": ("optimality", "synchronous", SUCCESSES),
    "asynchronous_optimality": ("optimality", "asynchronous", SUCCESSES),
    "synchronous_step_to_go_ratios": ("steps_to_go", "synchronous", FAILURES),
    "asynchronous_step_to_go_ratios": ("steps_to_go", "asynchronous", FAILURES),
    "synchronous_success_repeated_actions": ("repeated_transitions", "synchronous", SUCCESSES),
    "synchronous_failures_repeated_actions": ("repeated_transitions", "synchronous", FAILURES),
    "asynchronous_success_repeated_actions": ("repeated_transitions", "asynchronous", SUCCESSES),
    "asynchronous_failures_repeated_actions": ("repeated_transitions", "asynchronous", FAILURES),
}
"""Variables with a number for each episode: figure, data set and group of episodes."""

PIES = {
    "synchronous_piechart_data": ("synchronous", REACT),
    "asynchronous_piechart_data": ("asynchronous", REACT),
    "async_before_piechart_data": ("asynchronous", f"{REACT}, without prior"),
    "async_after_piechart_data": ("asynchronous", f"{REACT}, with prior"),
}
"""Variables with counts of failures: data set and player."""

CATEGORIES = {"S": "state", "A": "action", "T": "transition", "G": "goal"}
ASSIGNMENT = re.compile(rf"^({'|'.join([*SAMPLES, *PIES])})\s*=\s*(?=[\[{{])", re.MULTILINE)


def read_figures(root: Path) -> tuple[FigureData, ...]:
    """Return the numbers in a checkout's notebook; none if it has no notebook.

    Raises:
        FileError: The file is not a notebook, or one of the variables is not such a literal.
    """
    path = root / NOTEBOOK
    if not path.exists():
        return ()
    require_inside(path, root)
    found: dict[str, Any] = {}
    for cell in _cells(path):
        for match in ASSIGNMENT.finditer(cell):
            # Each variable is read once: a text can look like thousands of assignments.
            if match[1] not in found:
                found[match[1]] = _literal(path, match[1], cell[match.end() :])
    return tuple(data for name, value in found.items() for data in _data(path, name, value))


def _cells(path: Path) -> Iterator[str]:
    """Yield the source of each code cell that is short enough."""
    try:
        with open_regular(path) as file:
            content = file.read(MAX_NOTEBOOK_BYTES + 1)
        if len(content) > MAX_NOTEBOOK_BYTES:
            _fail(path, f"the file is longer than {MAX_NOTEBOOK_BYTES:,} bytes")
        text = content.decode("utf-8-sig")
        if (found := weight(text)) > MAX_VALUES:
            _fail(path, f"has up to {found:,} values; at most {MAX_VALUES:,} are read")
        notebook = json.loads(text)
    except OSError as error:
        _fail(path, f"cannot be read: {error.strerror or error}")
    except (ValueError, RecursionError):
        _fail(path, "is not a notebook: it is not JSON")
    cells = notebook.get("cells") if isinstance(notebook, dict) else None
    for cell in cells if isinstance(cells, list) else ():
        if not isinstance(cell, dict) or cell.get("cell_type") != "code":
            continue
        source = cell.get("source")
        lines: list[Any] = source if isinstance(source, list) else [source]
        if all(isinstance(line, str) for line in lines):
            text = "".join(lines)
            if len(text) <= MAX_CELL:
                yield text


def _literal(path: Path, name: str, text: str) -> Any:
    """Return the list or mapping at the beginning of a text."""
    try:
        return ast.literal_eval(" ".join(_tokens(text)))
    except (tokenize.TokenError, SyntaxError, ValueError, TypeError):
        _fail(path, f"{name}: expected a short literal of lists, mappings, texts and numbers")


def _tokens(text: str) -> list[str]:
    """Return the tokens up to the bracket that closes the first one.

    Raises:
        ValueError: There is no such bracket, or the literal is too long or has other contents.
    """
    depth = 0
    tokens: list[str] = []
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in (tokenize.NL, tokenize.NEWLINE, tokenize.COMMENT):
            continue
        tokens.append(token.string)
        depth += (token.string in ("[", "{")) - (token.string in ("]", "}"))
        if len(tokens) > MAX_TOKENS or depth > MAX_DEPTH or not _is_plain(token):
            break
        if depth == 0:
            return tokens
    raise ValueError("not a plain literal")


def _is_plain(token: tokenize.TokenInfo) -> bool:
    if token.type == tokenize.OP:
        return token.string in ("[", "]", "{", "}", ",", ":")
    return token.type in (tokenize.NUMBER, tokenize.STRING)


def _data(path: Path, name: str, value: Any) -> Iterator[FigureData]:
    if name in SAMPLES:
        figure, dataset, group = SAMPLES[name]
        yield FigureData(figure, dataset, REACT, group, _numbers(path, name, value))
        return
    dataset, player = PIES[name]
    for letter, part in value.items() if isinstance(value, dict) else ():
        category = CATEGORIES.get(str(letter))
        if category is None or not isinstance(part, dict):
            _fail(path, f"{name}: expected the categories {', '.join(CATEGORIES)}")
        counts = _numbers(path, name, part.get("values"))
        names = part.get("subcategories")
        if not isinstance(names, list) or len(names) != len(counts):
            _fail(path, f"{name}: expected a name for each count")
        for each, count in zip(names, counts, strict=True):
            subcategory = str(each)[:80].removeprefix(f"[{letter}] ")
            if not subcategory.isprintable():
                _fail(
                    path, f"{name}: the name {subcategory!a} has characters that are not printable"
                )
            yield FigureData("failures", dataset, player, f"{category}: {subcategory}", (count,))


def _numbers(path: Path, name: str, value: Any) -> tuple[float, ...]:
    numbers: list[Any] = value if isinstance(value, list) else [None]
    if not all(type(n) in (int, float) and 0 <= n < 1e6 for n in numbers):
        _fail(path, f"{name}: expected a list of numbers from 0 to 1,000,000")
    return tuple(float(number) for number in numbers)


def _fail(path: Path, message: str) -> NoReturn:
    raise FileError(str(path), [Fault("", message)])
