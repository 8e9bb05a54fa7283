"""Write the generated parts of the documentation, or check that they are up to date.

    python tools/generate_docs.py            write them
    python tools/generate_docs.py --check    exit with status 1 if a part is out of date

Tables of messages, settings, limits, metrics and commands, the AsyncAPI and OpenAPI documents and
the JSON Schemas come from the code, tables of plan lengths from the shipped certificates. In a
page, a generated part stands between `<!-- begin generated: NAME -->` and
`<!-- end generated: NAME -->`.
"""

from __future__ import annotations

import argparse
import importlib
import json
import re
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from enum import EnumType
from pathlib import Path
from typing import Any, Literal, get_args, get_origin
from unittest.mock import patch

import plan_lengths
import typer
from limit_table import limit_tables, message_costs
from markdown_tables import cell, table
from message_reference import (
    asyncapi,
    error_table,
    limit_words,
    message_reference,
    named_enums,
)
from mqtt_asyncapi import mqtt_asyncapi
from pydantic import BaseModel, SecretStr

from robotouille.domain.rendering import RenderingFile
from robotouille.domain.schema import DomainFile, InputFile, ProblemFile
from robotouille.replay.annotations import Codebook
from robotouille_client.cli.main import LazyGroup
from robotouille_server.operator import openapi
from robotouille_server.operator.principal import CODES
from robotouille_server.runtime.metrics import ClusterMetrics, Metrics
from robotouille_server.runtime.settings import ServerSettings

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
FILES = {
    "domain": DomainFile,
    "problem": ProblemFile,
    "input": InputFile,
    "rendering": RenderingFile,
    "codebook": Codebook,
}
Schema = dict[str, Any]


# Settings, metrics and commands


def shown(value: Any) -> str:
    """Return a default as the user would type it."""
    value = getattr(value, "value", value)
    if value is None or value == "":
        return ""
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def settings_table() -> str:
    """Return the table of all settings of the server."""
    schema = ServerSettings.model_json_schema()
    rows = []
    for name, field in ServerSettings.model_fields.items():
        values = named_enums(schema["properties"][name], schema.get("$defs", {}))
        choices = [s["enum"] for s in [values, *values.get("anyOf", ())] if "enum" in s]
        limits = [", ".join(f"`{value}`" for value in each) for each in choices]
        limits += limit_words(values)
        no_flag = (
            " (no flag)" if SecretStr in (field.annotation, *get_args(field.annotation)) else ""
        )
        meaning = cell(field.description or "")
        rows.append([f"`{name}`{no_flag}", shown(field.default), ", ".join(limits), meaning])
    return table("setting, default, values, meaning", rows)


def metrics_table() -> str:
    """Return the table of all metrics of the server."""
    metrics = Metrics()
    metrics.cluster = ClusterMetrics()
    rows = [
        [f"`{each.name}{'_total' * (each.type == 'counter')}`", each.type, cell(each.documentation)]
        for each in metrics.registry.collect()
    ]
    return table("metric, type, meaning", sorted(rows))


def operator_paths() -> str:
    """Return the table of all requests of the operator API."""
    document = openapi()
    rows = []
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            queries = [q["name"] for q in operation.get("parameters", ()) if q["in"] == "query"]
            names = queries or body_fields(operation, document["components"]["schemas"])
            inputs = ", ".join(f"`{name}`" for name in names)
            rows.append([f"`{method.upper()} {path}`", inputs, operation["summary"]])
    return table("request, parameters or body, effect", rows)


def body_fields(operation: Schema, schemas: Schema) -> Iterable[str]:
    content = operation.get("requestBody", {}).get("content", {})
    target = content.get("application/json", {}).get("schema", {}).get("$ref", "")
    return schemas.get(target.rpartition("/")[2], {}).get("properties", {})


def operator_errors() -> str:
    """Return the table of the operator API's error codes."""
    return table("code, meaning", ([f"`{code}`", cell(text)] for code, text in CODES.items()))


def application(target: str) -> typer.Typer:
    """Return the Typer application that an entry point, `module:function`, runs."""
    module, _, function = target.partition(":")
    run: list[typer.Typer] = []
    with patch.object(typer.Typer, "__call__", lambda self, *_, **__: run.append(self)):
        getattr(importlib.import_module(module), function)()
    return run[0]


def command_options() -> str:
    """Return a section for each command with its arguments and options."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines: list[str] = []
    for name, target in project["scripts"].items():
        root = typer.main.get_command(application(target))
        lines += [f"## {name}", ""]
        for path, command in walk_commands(name, root):
            lines += [f"### `{path}`", ""] if path != name else []
            lines += [cell(command.help or ""), ""]
            if name == "robotouille-server":
                lines += ["Every [setting](settings.md) is an option.", ""]
            else:
                lines += [option_table(command), ""]
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


def option_table(command: Any) -> str:
    rows = []
    for parameter in command.params:
        if parameter.name in ("help", "version"):
            continue
        if parameter.param_type_name == "argument":
            flags = f"`{parameter.name.upper()}{'…' * (parameter.nargs == -1)}`"
        else:
            flags = ", ".join(f"`{flag}`" for flag in (*parameter.opts, *parameter.secondary_opts))
        default = "required" if parameter.required else shown(parameter.default)
        if parameter.default is False:
            default = "off"
        variable = f" Environment variable: `{parameter.envvar}`." if parameter.envvar else ""
        meaning = cell(f"{parameter.help or ''}{variable}")
        rows.append([flags, default, parameter_values(parameter.type_descriptor), meaning])
    return table("argument or option, default, values, meaning", rows) if rows else "No options."


def parameter_values(described: Any) -> str:
    """Return the values that a parameter with Typer's type descriptor takes; empty if any."""
    kinds = [described.annotation, *get_args(described.annotation)]
    for kind in kinds:
        values = [each.value for each in kind] if isinstance(kind, EnumType) else []
        if get_origin(kind) is Literal:
            values = [*get_args(kind)]
        if values:
            return ", ".join(f"`{value}`" for value in values)
    least, most = described.parameter_info.min, described.parameter_info.max
    if most is None:
        return "" if least is None else f"at least {least:,}"
    return f"at most {most:,}" if least is None else f"{least:,} to {most:,}"


# The catalogue


def catalogue_tables() -> str:
    """Return the tables of the catalogue, with the type and meaning of each column."""
    from robotouille_data.schema import EPISODE_SEATS, EPISODE_TABLES, RECORDINGS, SEATS

    parts = [catalogue_table(table.name, table.columns) for table in EPISODE_TABLES]
    own = [column for column in EPISODE_SEATS.columns if column.name not in SEATS.columns]
    note = "A view with one row for each seat: all columns of `seats`, and these."
    parts.append(catalogue_table(EPISODE_SEATS.name, own, note))
    parts.append(catalogue_table(RECORDINGS.name, RECORDINGS.columns))
    return "\n\n".join(parts)


def exported_fields() -> str:
    """Return a table of the fields of `robotouille replay export`."""
    from robotouille.replay.controllers import EXPORTED

    rows = (
        (f"`{kind}`", name if name == "…" else f"`{name}`", words)
        for kind, fields in EXPORTED.items()
        for name, words in fields.items()
    )
    return table("`kind`, field, content", rows)


def catalogue_table(name: str, columns: Iterable[Any], note: str = "") -> str:
    rows = (
        [
            f"`{column.name}`",
            type(column.type).__name__.lower() + ", or null" * column.nullable,
            column.doc,
        ]
        for column in columns
    )
    text = table("column, type, meaning", rows)
    return "\n\n".join(filter(None, [f"### {name}", note, text]))


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
    """Add the lists of the published dialect, which the model merges into `objects`."""
    things = schema["properties"]["objects"]["additionalProperties"]
    for plural in ("stations", "items", "containers", "meals", "players"):
        schema["properties"][plural] = {**things, "title": plural.title()}


def as_json(value: Any) -> str:
    return json.dumps(value, indent=2, ensure_ascii=False) + "\n"


def page(path: Path, parts: dict[str, Callable[[], str]]) -> str:
    """Return a page with updated generated parts."""
    text = path.read_text(encoding="utf-8")
    for name, generate in parts.items():
        begin, end = f"<!-- begin generated: {name} -->", f"<!-- end generated: {name} -->"
        pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
        if len(pattern.findall(text)) != 1:
            raise SystemExit(f"{path}: needs exactly one pair of markers for {name!r}")
        part = f"{begin}\n\n{generate()}\n\n{end}"
        text = pattern.sub(lambda _, part=part: part, text)
    return text


def outputs() -> Iterator[tuple[Path, str]]:
    """Yield every generated file with its content."""
    parts = {
        "message costs": lambda: f"Some messages count as several: {message_costs()}.",
        "errors": error_table,
    }
    yield DOCS / "protocol.md", page(DOCS / "protocol.md", parts)
    yield DOCS / "messages.md", page(DOCS / "messages.md", {"messages": message_reference})
    parts = {"settings": settings_table, "metrics": metrics_table}
    yield DOCS / "settings.md", page(DOCS / "settings.md", parts)
    yield DOCS / "limits.md", page(DOCS / "limits.md", {"limits": limit_tables})
    parts = {"operator api": operator_paths, "operator errors": operator_errors}
    yield DOCS / "operate_a_server.md", page(DOCS / "operate_a_server.md", parts)
    yield DOCS / "cli.md", page(DOCS / "cli.md", {"commands": command_options})
    parts = {
        "default tasks": plan_lengths.default_table,
        "generated totals": plan_lengths.generated_totals,
        "generated instances": plan_lengths.generated_table,
    }
    yield DOCS / "plan_lengths.md", page(DOCS / "plan_lengths.md", parts)
    parts = {"exported fields": exported_fields}
    yield DOCS / "recordings.md", page(DOCS / "recordings.md", parts)
    tables = {"catalogue tables": catalogue_tables}
    yield DOCS / "data.md", page(DOCS / "data.md", tables)
    yield DOCS / "asyncapi.json", as_json(asyncapi())
    yield DOCS / "asyncapi-mqtt.json", as_json(mqtt_asyncapi())
    yield DOCS / "openapi.json", as_json(openapi())
    for name, model in FILES.items():
        yield DOCS / "schemas" / f"{name}.json", as_json(file_schema(name, model))


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or list what is out of date and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="list what is out of date")
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
