"""The AsyncAPI document says what is published, and what may be asked for."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest

from robotouille_server.mqtt.asyncapi import document
from robotouille_server.mqtt.models import COMMANDS
from robotouille_server.mqtt.topics import Topics
from tests.support.pages import read, table

DOCUMENT = document()


def references(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        if isinstance(value.get("$ref"), str):
            yield value["$ref"]
        for each in value.values():
            yield from references(each)
    elif isinstance(value, list):
        for each in value:
            yield from references(each)


def resolved(reference: str) -> Any:
    found: Any = DOCUMENT
    for part in reference.removeprefix("#/").split("/"):
        found = found[part]
    return found


def test_every_reference_leads_somewhere() -> None:
    found = set(references(DOCUMENT))
    assert len(found) > 20
    for reference in found:
        assert resolved(reference)


def test_topics_are_those_of_the_code() -> None:
    topics = Topics("{server}")
    addresses = {channel["address"] for channel in DOCUMENT["channels"].values()}
    assert addresses == {
        topics.presence,
        topics.commands,
        topics.answers,
        topics.life("{episode}"),
        topics.steps("{episode}"),
    }
    for channel in DOCUMENT["channels"].values():
        assert set(re.findall(r"\{(\w+)\}", channel["address"])) == set(channel["parameters"])


def test_every_channel_has_an_operation() -> None:
    used = {op["channel"]["$ref"].rpartition("/")[2] for op in DOCUMENT["operations"].values()}
    assert used == set(DOCUMENT["channels"])


def test_the_page_has_every_topic_and_command() -> None:
    rows = {
        row[0].replace("SERVER", "{server}").replace("ID", "{episode}")
        for row in table("mqtt.md", "Topics")
    }
    assert {row.removesuffix(" and below").replace("`", "") for row in rows} == {
        channel["address"] for channel in DOCUMENT["channels"].values()
    }
    kinds = {kind for row in table("mqtt.md", "Commands") for kind in row[0].split(", ")}
    assert {kind.strip("`") for kind in kinds} == {
        model.model_json_schema()["properties"]["type"]["const"] for model in COMMANDS
    }


@pytest.mark.parametrize("payload", re.findall(r"^\{.*\}$|'(\{.*\})'", read("mqtt.md"), re.M))
def test_what_is_shown_is_json(payload: str) -> None:
    if payload:
        assert json.loads(payload.replace("'$TOKEN'", "token"))
