"""Rows of a report as Parquet, one column for each number, with fixed types."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel

from robotouille_evaluation.metrics.rows import Category, Number, ResultRow

TYPES: Mapping[object, pa.DataType] = {
    bool: pa.bool_(),
    int: pa.int64(),
    float: pa.float64(),
    str: pa.string(),
    Category: pa.string(),
    tuple[Number, ...]: pa.list_(pa.int64()),
    dict[str, float]: pa.map_(pa.string(), pa.float64()),
}


def _bare(annotation: object) -> Any:
    """Return the type without `None` and without constraints."""
    if get_origin(annotation) in (Union, UnionType):
        (annotation,) = (part for part in get_args(annotation) if part is not type(None))
    if get_origin(annotation) is Annotated:
        annotation = get_args(annotation)[0]
    return annotation


def _fields(model: type[BaseModel], prefix: str = "") -> Iterator[pa.Field]:
    """Yield the columns. Nested fields are flattened: `outcome.steps` is `outcome_steps`."""
    for name, field in model.model_fields.items():
        kind = _bare(field.annotation)
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from _fields(kind, f"{prefix}{name}_")
        else:
            yield pa.field(prefix + name, TYPES[kind])


SCHEMA = pa.schema(_fields(ResultRow))
"""Schema of every file. A column without values keeps its type, so files can be concatenated."""


def _flat(part: BaseModel, prefix: str = "") -> Iterator[tuple[str, object]]:
    for name in type(part).model_fields:
        value = getattr(part, name)
        if isinstance(value, BaseModel):
            yield from _flat(value, f"{prefix}{name}_")
        else:
            yield prefix + name, value


def write_parquet(rows: Sequence[ResultRow], path: Path) -> None:
    """Write the rows to a file. Equal rows give equal bytes.

    Raises:
        OSError: The file cannot be written.
    """
    table = pa.Table.from_pylist([dict(_flat(row)) for row in rows], schema=SCHEMA)
    pq.write_table(table, path)
