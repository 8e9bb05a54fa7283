"""Reference of the protocol's messages: tables, error codes, and the AsyncAPI document."""

from __future__ import annotations

import ast
import inspect
import json
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

from markdown_tables import cell, table
from message_examples import EXAMPLES
from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from robotouille.protocol import error_codes, messages
from robotouille.protocol.codec import SUBPROTOCOLS

__all__ = ["asyncapi", "error_table", "limit_words", "message_reference", "named_enums"]

Schema = dict[str, Any]


def message_type(model: type[BaseModel]) -> str:
    return str(model.model_fields["type"].default)


def schemas_of(models: tuple[type[BaseModel], ...]) -> dict[str, Schema]:
    """Return the JSON Schemas of messages and of their nested objects, by class name."""
    template = "#/components/schemas/{model}"
    _, found = models_json_schema([(m, "validation") for m in models], ref_template=template)
    schemas: dict[str, Schema] = found["$defs"]
    for model in models:
        required = schemas[model.__name__].setdefault("required", [])
        required.insert(0, "type")
    return schemas


def type_words(schema: Schema) -> str:
    """Return a field's type in words."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "const" in schema:
        return f"`{json.dumps(schema['const'])}`"
    if "enum" in schema:
        return ", ".join(f"`{json.dumps(value)}`" for value in schema["enum"])
    if "anyOf" in schema:
        return " or ".join(type_words(part) for part in schema["anyOf"])
    if schema.get("type") == "array":
        inner = schema.get("items")
        return f"list of {type_words(inner)}" if inner else "list"
    if schema.get("type") == "object":
        inner = schema.get("additionalProperties")
        return f"map to {type_words(inner)}" if isinstance(inner, dict) else "object"
    return str(schema.get("type", "any"))


def limit_words(schema: Schema) -> Iterator[str]:
    """Yield a field's limits, including those of its alternatives and entries."""
    for low, high, unit in [
        ("minimum", "maximum", ""),
        ("minLength", "maxLength", " characters"),
        ("minItems", "maxItems", " entries"),
    ]:
        least, most = number(schema, low), number(schema, high)
        above = number(schema, "exclusiveMinimum") if low == "minimum" else ""
        if above and most:
            yield f"above {above}, at most {most}"
        elif least and most:
            yield f"{least} to {most}{unit}"
        elif above or least or most:
            words = f"above {above}" if above else f"at least {least}" if least else ""
            yield (words or f"at most {most}") + unit
    for part in schema.get("anyOf", ()):
        yield from limit_words(part)
    if "items" in schema:
        yield from (f"each {words}" for words in limit_words(schema["items"]))


def number(schema: Schema, key: str) -> str:
    value = schema.get(key)
    return "" if value is None else f"{value:,}" if isinstance(value, int) else f"{value:,g}"


def default_words(name: str, schema: Schema, required: list[str]) -> str:
    if name in required:
        return "required"
    return f"`{json.dumps(schema.get('default'))}`"


def named_enums(schema: Schema, schemas: dict[str, Schema]) -> Schema:
    """Return a field's schema with references to enumerations replaced by their values."""
    if "anyOf" in schema:
        return {**schema, "anyOf": [named_enums(part, schemas) for part in schema["anyOf"]]}
    target = schemas.get(schema.get("$ref", "").rpartition("/")[2], {})
    return target if "enum" in target else schema


def field_table(schema: Schema, schemas: dict[str, Schema]) -> str:
    """Return the table of a message's fields."""
    rows = []
    for name, raw in schema["properties"].items():
        if name == "type":
            continue
        field = named_enums(raw, schemas)
        words = ", ".join(dict.fromkeys([type_words(field), *limit_words(field)]))
        default = default_words(name, raw, schema.get("required", []))
        rows.append([f"`{name}`", words, default, cell(raw["description"])])
    return table("field, type, default, meaning", rows) if rows else "No fields."


def paragraph(text: str) -> str:
    """Return a docstring with one line for each paragraph."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))


def message_reference() -> str:
    """Return one section for each message, then one for each nested object."""
    schemas = schemas_of(messages.CLIENT_MESSAGES + messages.SERVER_MESSAGES)
    lines: list[str] = []
    for title, models in [
        ("From client to server", messages.CLIENT_MESSAGES),
        ("From server to client", messages.SERVER_MESSAGES),
    ]:
        lines += [f"## {title}", ""]
        for model in models:
            name, schema = message_type(model), schemas.pop(model.__name__)
            example = json.dumps(EXAMPLES[name], ensure_ascii=False)
            lines += [f"### `{name}`", "", paragraph(schema["description"]), ""]
            lines += [field_table(schema, schemas), "", "```json", example, "```", ""]
    lines += ["## Nested objects", ""]
    for name, schema in schemas.items():
        if "properties" in schema:
            lines += [f"### {name}", "", paragraph(schema["description"]), ""]
            lines += [field_table(schema, schemas), ""]
    return "\n".join(lines).rstrip()


def error_table() -> str:
    """Return the table of error codes, with the docstrings of `ErrorCode`'s members."""
    tree = ast.parse(inspect.getsource(error_codes.ErrorCode))
    body = next(node.body for node in tree.body if isinstance(node, ast.ClassDef))
    rows = []
    for code, words in pairwise(body):
        if isinstance(code, ast.Assign):
            if not isinstance(words, ast.Expr):
                raise SystemExit(f"{ast.unparse(code)} needs a docstring")
            rows.append([f"`{ast.literal_eval(code.value)}`", cell(ast.literal_eval(words.value))])
    return table("code, meaning", rows)


def asyncapi() -> Schema:
    """Return the protocol as an AsyncAPI 3.0 document, from the server's point of view."""
    schemas = schemas_of(messages.CLIENT_MESSAGES + messages.SERVER_MESSAGES)

    def described(model: type[BaseModel]) -> Schema:
        name = message_type(model)
        return {
            "name": name,
            "summary": paragraph(model.__doc__ or ""),
            "payload": {"$ref": f"#/components/schemas/{model.__name__}"},
            "examples": [{"payload": EXAMPLES[name]}],
        }

    def operation(action: str, models: tuple[type[BaseModel], ...]) -> Schema:
        return {
            "action": action,
            "channel": {"$ref": "#/channels/connection"},
            "messages": [
                {"$ref": f"#/channels/connection/messages/{message_type(m)}"} for m in models
            ],
        }

    everything = messages.CLIENT_MESSAGES + messages.SERVER_MESSAGES
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "Robotouille",
            "version": f"{messages.PROTOCOL_VERSION}.0.0",
            "description": "The wire protocol of Robotouille servers. Subprotocols: "
            + ", ".join(SUBPROTOCOLS)
            + ". protocol.md explains the rules.",
        },
        "defaultContentType": "application/json",
        "servers": {"local": {"host": "127.0.0.1:8765", "protocol": "ws"}},
        "channels": {
            "connection": {
                "address": "/",
                "messages": {
                    message_type(m): {"$ref": f"#/components/messages/{message_type(m)}"}
                    for m in everything
                },
            }
        },
        "operations": {
            "receive": operation("receive", messages.CLIENT_MESSAGES),
            "send": operation("send", messages.SERVER_MESSAGES),
        },
        "components": {
            "messages": {message_type(m): described(m) for m in everything},
            "schemas": schemas,
        },
    }
