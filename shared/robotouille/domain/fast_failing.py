"""Validation that stops at the first invalid value of a list.

pydantic reports every invalid value. Errors about a million of them take gigabytes and a minute, so
that values from strangers are validated with these schemas.
"""

from __future__ import annotations

import copy
from typing import Any

from pydantic_core import CoreSchema, SchemaValidator

_LISTS = ("list", "tuple", "set", "frozenset")


def fast_failing(schema: CoreSchema) -> SchemaValidator:
    """Return a validator for a schema that reports at most one invalid value of each list."""
    schema = copy.deepcopy(schema)
    waiting: list[Any] = [schema]
    while waiting:
        part = waiting.pop()
        if isinstance(part, dict):
            if part.get("type") in _LISTS:
                part["fail_fast"] = True
            waiting.extend(part.values())
        elif isinstance(part, list | tuple):
            waiting.extend(part)
    # Newer versions of pydantic would use the models' own validators, which report everything.
    own: dict[str, Any] = {"_use_prebuilt": False}
    try:
        return SchemaValidator(schema, None, **own)
    except TypeError:
        return SchemaValidator(schema)


MAX_NAMES = 10_000
"""Largest number of names in an object. Validators report every unknown name and wrong value."""


def has_more_values(value: Any, limit: int) -> bool:
    """Return whether a JSON value holds more than a number of values, at any depth.

    Raises:
        ValueError: An object has more than `MAX_NAMES` names.
    """
    waiting, found = [value], 0
    while waiting:
        inner = waiting.pop()
        if isinstance(inner, dict):
            if len(inner) > MAX_NAMES:
                raise ValueError(f"{len(inner):,} names in one object; at most {MAX_NAMES:,}")
            inner = inner.values()
        elif not isinstance(inner, list | tuple):
            continue
        found += len(inner)
        if found > limit:
            return True
        waiting.extend(inner)
    return False
