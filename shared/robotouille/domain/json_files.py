"""Reading of JSON files against a schema, with all their faults.

Files may come from anyone, so their size, nesting and fields are checked before use.
"""

from __future__ import annotations

import copy
import json
import re
import sys
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, SchemaValidator

from robotouille.domain.fast_failing import fast_failing, has_more_values
from robotouille.domain.schema import EFFECT_KINDS
from robotouille.errors import Fault, FileError, bounded, did_you_mean
from robotouille.files.reading import MAX_FILE_BYTES, content_kind, read_bytes

MAX_NESTING = 40
MAX_VALUES = 4_000_000
"""Largest `weight` of a text. The values then take at most about 250 MB."""
MANY = 50_000
"""Values of a file from which on only the first fault of each list is reported."""

M = TypeVar("M", bound=BaseModel)


def read_json(path: Path) -> Any:
    """Return the JSON value in a file.

    Raises:
        FileError: The file cannot be read or is not JSON.
    """
    try:
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            _fail(path, f"the file has {size:,} bytes; at most {MAX_FILE_BYTES:,} are read")
        # The file may have grown since its size was checked.
        content = read_bytes(path)
        text = content.decode("utf-8-sig")
    except IsADirectoryError:
        _fail(path, "is a folder; expected a JSON file")
    except OSError as error:
        _fail(path, f"cannot be read: {error.strerror or error}")
    except UnicodeDecodeError as error:
        kind = content_kind(content)
        if kind != "a text file":
            _fail(path, f"is {kind}; expected a JSON file")
        _fail(path, f"is not UTF-8 text: byte {error.start} is {error.object[error.start]:#04x}")
    except ValueError as error:
        _fail(path, f"cannot be read: {error}")
    return parse_json(text, str(path))


def parse_json(text: str, source: str, most: int = MAX_VALUES) -> Any:
    """Return the JSON value in a text.

    Args:
        most: Largest `weight` of the text.

    Raises:
        FileError: The text is not JSON, or has duplicate names, NaN, deep nesting or too many
            values.
    """
    if not text or text.isspace():
        _fail(source, "the file is empty; expected a JSON object")
    # Decoded values take up to 25 times the memory of their text.
    if len(text) > most and (found := weight(text)) > most:
        _fail(source, f"has up to {found:,} values; at most {most:,} are read")
    _check_nesting(text, source)
    try:
        value = json.loads(text, object_pairs_hook=_unique_pairs, parse_constant=_no_constant)
    except json.JSONDecodeError as error:
        _fail(source, f"is not JSON: {error.msg} at line {error.lineno}, column {error.colno}")
    except ValueError as error:
        if "int_max_str_digits" in str(error):  # Python's advice is not for users.
            most_digits = sys.get_int_max_str_digits()
            _fail(source, f"has an integer with more than {most_digits:,} digits")
        _fail(source, f"is not JSON: {error}")
    _check_text(text, value, source)
    return value


def weight(text: str) -> int:
    """Return an upper bound of the values of a JSON text, in units of about 50 bytes of memory.

    An array counts as two values, an object as four.
    """
    return text.count(",") + 2 * text.count("[") + 4 * text.count("{")


def _check_text(text: str, value: Any, source: str | Path) -> None:
    r"""Reject a lone surrogate such as `\ud800`, which can be neither displayed nor stored."""
    if "\\ud" not in text and "\\uD" not in text:
        return
    try:
        json.dumps(value, ensure_ascii=False).encode()
    except UnicodeEncodeError as error:
        surrogate = ord(error.object[error.start])
        _fail(source, f"has a lone surrogate, \\u{surrogate:04x}, in a string")


def read_model(path: Path, model: type[M]) -> M:
    """Read a file as a `model`.

    Raises:
        FileError: The file is invalid; the error lists all its faults.
    """
    return validate(read_json(path), model, str(path))


def validate(raw: Any, model: type[M], source: str) -> M:
    """Convert a JSON value to a `model`.

    Raises:
        FileError: The value is invalid; the error lists all its faults.
    """
    try:
        if _is_large(raw, source):
            _quick(model).validate_python(raw)
        return model.model_validate(raw)
    except ValidationError as error:
        raise FileError(source, _faults(raw, model, _errors(error))) from None


def _is_large(raw: Any, source: str) -> bool:
    try:
        return has_more_values(raw, MANY)
    except ValueError as error:
        raise FileError(source, [Fault("", str(error))]) from None


@cache
def _quick(model: type[BaseModel]) -> SchemaValidator:
    return fast_failing(model.__pydantic_core_schema__)


def known_part(raw: Any, model: type[M]) -> M | None:
    """Return a JSON value as a `model` without its unknown fields, or None if it has other faults.

    An invalid file can then be checked further, unless it is very large.
    """
    try:
        if _is_large(raw, ""):
            return None
        part = copy.deepcopy(raw)
        return model.model_validate(part)
    except FileError:
        return None
    except ValidationError as error:
        errors = _errors(error)
    try:
        for each in errors:
            if each["type"] != "extra_forbidden":
                return None
            place = part
            for step in _location(each)[:-1]:
                place = place[step]
            del place[each["loc"][-1]]
        return model.model_validate(part)
    except (LookupError, TypeError, ValidationError):
        # The place is not in the file: the published dialect is converted before validation.
        return None


def _fail(source: str | Path, message: str) -> NoReturn:
    raise FileError(str(source), [Fault("", message)])


# The possessive quantifier, and matching unclosed strings to the end, keep this linear on any
# input.
_STRING = re.compile(r'"(?:[^"\\]|\\.)*+(?:"|\\?\Z)', re.DOTALL)


def _check_nesting(text: str, source: str) -> None:
    depth = 0
    for bracket in re.findall(r"[\[\]{}]", _STRING.sub("", text)):
        depth += 1 if bracket in "[{" else -1
        if depth > MAX_NESTING:
            _fail(source, f"is nested more than {MAX_NESTING} levels deep")


def _unique_pairs(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise ValueError(f"the name {key!r} occurs twice in one object")
        result[key] = value
    return result


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def _errors(error: ValidationError) -> list[ErrorDetails]:
    """Return pydantic's errors, except lists that are too short only because of invalid items."""
    errors = error.errors()
    invalid_inside = {e["loc"][:i] for e in errors for i in range(len(e["loc"]))}
    return [e for e in errors if e["type"] != "too_short" or e["loc"] not in invalid_inside]


@bounded
def _faults(raw: Any, model: type[BaseModel], errors: list[ErrorDetails]) -> list[Fault]:
    return [_fault(raw, model, error) for error in errors]


def _fault(raw: Any, model: type[BaseModel], error: Any) -> Fault:
    location = _location(error)
    message = error["msg"].removeprefix("Value error, ")
    if error["type"] == "extra_forbidden":
        message = f"unknown field {location[-1]!r}"
        elsewhere = [name for name in _fields_near(model) if name != location[-1]]
        message += did_you_mean(str(location[-1]), elsewhere)
    elif error["type"] != "missing":
        message = f"{message[0].lower()}{message[1:]}"
        if not (error["type"] == "value_error" and isinstance(error["input"], dict)):
            message += f", found {_short(error['input'])}{_name_in(error)}"
    return Fault(_path(raw, location), message)


def _name_in(error: Any) -> str:
    """Return a suggestion if a path is given where the last name in it is expected."""
    if error["type"] != "string_pattern_mismatch":
        return ""
    name = error["input"].replace("\\", "/").rstrip("/").rpartition("/")[2]
    fits = name != error["input"] and re.search(error["ctx"]["pattern"], name)
    return f"; did you mean {name!r}?" if fits else ""


def _location(error: Any) -> list[Any]:
    """Return the steps to a value in the file; pydantic also lists the kinds of effects."""
    return [part for part in error["loc"] if part not in EFFECT_KINDS or isinstance(part, int)]


@cache
def _fields_near(model: type[BaseModel]) -> list[str]:
    # Suggest fields of all models in the file: a field is often right but in the wrong place.
    names: set[str] = set()
    pending: list[type[BaseModel]] = [model]
    seen: set[type[BaseModel]] = set()
    while pending:
        current = pending.pop()
        if current in seen:
            continue
        seen.add(current)
        for name, field in current.model_fields.items():
            names.add(field.alias or name)
            pending.extend(_models_in(field.annotation))
    return sorted(names)


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for part in getattr(annotation, "__args__", ()) for m in _models_in(part)]


def _path(raw: Any, location: list[Any]) -> str:
    """Format a location as `action_defs[4].precons[1].predicate`."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return _path_in_file(text, raw)


def as_in_file(faults: Iterable[Fault], raw: Any) -> list[Fault]:
    """Return a problem's faults with their places in its file."""
    return [replace(fault, path=_path_in_file(fault.path, raw)) for fault in faults]


def _path_in_file(path: str, raw: Any) -> str:
    # The published dialect has lists such as `items` where the model has `objects.item`.
    name = re.match(r"objects\.([^.\[]+)", path)
    if name is None or not isinstance(raw, dict) or f"{name[1]}s" not in raw:
        return path
    return f"{name[1]}s{path[name.end() :]}"


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return "an object"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
