"""Write the generated parts of the documentation, or say whether they are current.

    python tools/generate_docs.py            write them
    python tools/generate_docs.py --check    exit status 1 if one is out of date

Message tables, settings, command-line options, limits, the AsyncAPI and OpenAPI documents and the
JSON Schemas come from the code; meanings and examples of messages from docs/messages.json; tables
of plan lengths from the shipped certificates. In pages, the generated part lies between
`<!-- begin generated: NAME -->` and `<!-- end generated: NAME -->`.
"""

from __future__ import annotations

import argparse
import importlib
import json
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

import plan_lengths
import typer
from pydantic import BaseModel, SecretStr
from pydantic.json_schema import models_json_schema

from robotouille.domain.rendering import RenderingFile
from robotouille.domain.schema import DomainFile, InputFile, ProblemFile
from robotouille.protocol import messages
from robotouille.protocol.codec import SUBPROTOCOLS
from robotouille_client.cli.lazy_group import LazyGroup
from robotouille_server.admin import openapi
from robotouille_server.limit_table import limits_page
from robotouille_server.mqtt import asyncapi as mqtt_asyncapi
from robotouille_server.runtime.settings import ServerSettings

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
FILES = {
    "domain": DomainFile,
    "problem": ProblemFile,
    "input": InputFile,
    "rendering": RenderingFile,
}
Schema = dict[str, Any]


# Messages


def meanings() -> Any:
    """The hand-written part of the message reference."""
    return json.loads((DOCS / "messages.json").read_text(encoding="utf-8"))


def message_type(model: type[BaseModel]) -> str:
    return str(model.model_fields["type"].default)


def schemas_of(models: tuple[type[BaseModel], ...]) -> dict[str, Schema]:
    """The JSON Schemas of messages and of their parts, by class name."""
    template = "#/components/schemas/{model}"
    _, found = models_json_schema([(m, "validation") for m in models], ref_template=template)
    schemas: dict[str, Schema] = found["$defs"]
    for model in models:
        required = schemas[model.__name__].setdefault("required", [])
        required.insert(0, "type")
    return schemas


def type_words(schema: Schema) -> str:
    """A field's type in words."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})" if name in meanings()["parts"] else "object"
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
    """A field's limits, those of its alternatives and entries included."""
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
    """A field's schema with references to enumerations replaced by their values."""
    if "anyOf" in schema:
        return {**schema, "anyOf": [named_enums(part, schemas) for part in schema["anyOf"]]}
    target = schemas.get(schema.get("$ref", "").rpartition("/")[2], {})
    return target if "enum" in target else schema


def field_table(schema: Schema, schemas: dict[str, Schema], words: dict[str, str]) -> list[str]:
    rows = ["| field | type | default | limits | meaning |", "| --- | --- | --- | --- | --- |"]
    for name, raw in schema["properties"].items():
        if name == "type":
            continue
        field = named_enums(raw, schemas)
        limits = ", ".join(dict.fromkeys(limit_words(field)))
        default = default_words(name, raw, schema.get("required", []))
        meaning = words.get(name) or meanings()["shared"][name]
        rows.append(f"| `{name}` | {type_words(field)} | {default} | {limits} | {meaning} |")
    return rows if len(rows) > 2 else ["No fields."]


def paragraph(text: str) -> str:
    """A docstring as one line a paragraph."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))


def message_reference() -> str:
    """One section for each message, then one for each part of messages."""
    written = meanings()
    schemas = schemas_of(messages.CLIENT_MESSAGES + messages.SERVER_MESSAGES)
    lines: list[str] = []
    for title, models in [
        ("From client to server", messages.CLIENT_MESSAGES),
        ("From server to client", messages.SERVER_MESSAGES),
    ]:
        lines += [f"### {title}", ""]
        for model in models:
            name = message_type(model)
            entry = written["messages"][name]
            example = json.dumps(entry["example"], ensure_ascii=False)
            lines += [f"#### `{name}`", "", paragraph(model.__doc__ or ""), ""]
            table = field_table(schemas[model.__name__], schemas, entry["fields"])
            lines += [*table, "", "```json", example, "```", ""]
    lines += ["### Parts of messages", ""]
    for name, words in written["parts"].items():
        lines += [f"#### {name}", "", paragraph(schemas[name]["description"]), ""]
        lines += [*field_table(schemas[name], schemas, words), ""]
    return "\n".join(lines).rstrip()


def asyncapi() -> Schema:
    """The protocol as an AsyncAPI 3.0 document, as the server sees it."""
    written = meanings()["messages"]
    schemas = schemas_of(messages.CLIENT_MESSAGES + messages.SERVER_MESSAGES)

    def described(model: type[BaseModel]) -> Schema:
        name = message_type(model)
        return {
            "name": name,
            "summary": paragraph(model.__doc__ or ""),
            "payload": {"$ref": f"#/components/schemas/{model.__name__}"},
            "examples": [{"payload": written[name]["example"]}],
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
            + ". See protocol.md for what schemas cannot say.",
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


# Settings and options


def shown(value: Any) -> str:
    """A default as a reader would type it."""
    value = getattr(value, "value", value)
    if value is None or value == "":
        return ""
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def settings_table() -> str:
    """Every setting of the server."""
    properties = ServerSettings.model_json_schema()["properties"]
    definitions = ServerSettings.model_json_schema().get("$defs", {})
    rows = [
        "| flag | environment variable, file key | default | limits | meaning |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, field in ServerSettings.model_fields.items():
        schema = named_enums(properties[name], definitions)
        choices = [s["enum"] for s in [schema, *schema.get("anyOf", ())] if "enum" in s]
        limits = [", ".join(f"`{v}`" for v in values) for values in choices]
        limits += list(limit_words(schema))
        rows.append(
            f"| {setting_flags(name, field.annotation)} | `ROBOTOUILLE_{name.upper()}`, `{name}` "
            f"| {shown(field.default)} | {', '.join(limits)} | {cell(field.description or '')} |"
        )
    return "\n".join(rows)


def setting_flags(name: str, annotation: Any) -> str:
    """The flags of a setting; a secret has none, since everybody can read a command line."""
    flag = name.replace("_", "-")
    if annotation is SecretStr or SecretStr in get_args(annotation):
        return "none"
    return f"`--{flag}`, `--no-{flag}`" if annotation is bool else f"`--{flag}`"


def commands() -> dict[str, typer.Typer]:
    """The Typer applications that are documented."""
    modules = {
        name: importlib.import_module(f"robotouille_client.{path}.cli")
        for name, path in [
            ("robotouille-client", "window"),
            ("robotouille-bot", "bots"),
            ("robotouille-loadtest", "loadtest"),
            ("robotouille-mcp", "mcp_server"),
            ("robotouille-lsl", "lsl"),
        ]
    }
    applications = {
        "robotouille": importlib.import_module("robotouille_client.cli.main").app,
        "robotouille-token": importlib.import_module(
            "robotouille_server.auth.token_cli"
        ).token_app(),
    }
    for name, module in modules.items():
        applications[name] = typer.Typer(add_completion=False)
        applications[name].command()(module.command)
    return applications


def command_options() -> str:
    """A section for each command with its arguments and options."""
    lines: list[str] = []
    for name, application in commands().items():
        for path, command in walk_commands(name, typer.main.get_command(application)):
            lines += [f"### `{path}`", "", cell(command.help or ""), "", *option_table(command), ""]
    return "\n".join(lines).rstrip()


def walk_commands(path: str, command: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(command, LazyGroup):
        command.load()
    inner = getattr(command, "commands", None)
    if inner is None:
        yield path, command
        return
    for name, child in inner.items():
        yield from walk_commands(f"{path} {name}", child)


def option_table(command: Any) -> list[str]:
    rows = ["| argument or flag | default | meaning |", "| --- | --- | --- |"]
    for parameter in command.params:
        if parameter.name == "help":
            continue
        if parameter.param_type_name == "argument":
            dots = "…" if parameter.nargs == -1 else ""
            flags = f"`{parameter.name.upper()}{dots}`"
        else:
            flags = ", ".join(f"`{flag}`" for flag in (*parameter.opts, *parameter.secondary_opts))
        default = "required" if parameter.required else shown(parameter.default)
        if parameter.default is False:
            default = "off"
        rows.append(f"| {flags} | {default} | {cell(parameter_words(parameter))} |")
    return rows


def parameter_words(parameter: Any) -> str:
    """What a parameter means, and the variable that can take its place."""
    variable = f" Or the variable `{parameter.envvar}`." if parameter.envvar else ""
    return f"{parameter.help or ''}{variable}"


# Pages and files


def file_schema(name: str, model: type[BaseModel]) -> Schema:
    schema = model.model_json_schema(by_alias=True)
    if model is ProblemFile:
        add_published_lists(schema)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"Robotouille {name} file",
        **{key: value for key, value in schema.items() if key != "title"},
    }


def add_published_lists(schema: Schema) -> None:
    """The lists of the published dialect, which the model folds into `objects`."""
    things = schema["properties"]["objects"]["additionalProperties"]
    for plural in ("stations", "items", "containers", "meals", "players"):
        schema["properties"][plural] = {**things, "title": plural.title()}


def as_json(value: Any) -> str:
    return json.dumps(value, indent=2, ensure_ascii=False) + "\n"


def page(path: Path, parts: dict[str, Callable[[], str]]) -> str:
    """A page with its generated parts written anew."""
    text = path.read_text(encoding="utf-8")
    for name, generate in parts.items():
        begin, end = f"<!-- begin generated: {name} -->", f"<!-- end generated: {name} -->"
        pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
        if len(pattern.findall(text)) != 1:
            raise SystemExit(f"{path}: needs the markers of {name!r} once")
        part = f"{begin}\n\n{generate()}\n\n{end}"
        text = pattern.sub(lambda _, part=part: part, text)
    return text


def outputs() -> Iterator[tuple[Path, str]]:
    """Every generated file with what should be in it."""
    yield DOCS / "protocol.md", page(DOCS / "protocol.md", {"messages": message_reference})
    parts = {"settings": settings_table, "options": command_options}
    yield DOCS / "settings.md", page(DOCS / "settings.md", parts)
    limits = {"limits": lambda: limits_page().rstrip()}
    yield DOCS / "limits.md", page(DOCS / "limits.md", limits)
    parts = {
        "default tasks": plan_lengths.default_table,
        "generated totals": plan_lengths.generated_totals,
        "generated instances": plan_lengths.generated_table,
    }
    yield DOCS / "plan_lengths.md", page(DOCS / "plan_lengths.md", parts)
    yield DOCS / "asyncapi.json", as_json(asyncapi())
    yield DOCS / "asyncapi-mqtt.json", as_json(mqtt_asyncapi.document())
    yield DOCS / "openapi.json", as_json(openapi())
    for name, model in FILES.items():
        yield DOCS / "schemas" / f"{name}.json", as_json(file_schema(name, model))


def main(arguments: Sequence[str] | None = None) -> int:
    """Write what is out of date, or say so; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="write nothing")
    check = parser.parse_args(arguments).check
    stale = []
    for path, text in outputs():
        current = path.read_text(encoding="utf-8") if path.is_file() else None
        if current == text:
            continue
        stale.append(path.relative_to(ROOT))
        if not check:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    for path in stale:
        print(f"{path}: {'out of date' if check else 'written'}")
    if check and stale:
        print("run: python tools/generate_docs.py")
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
