"""The topics and their messages as an AsyncAPI 3.0 document, for docs/asyncapi-mqtt.json."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from robotouille_server.mqtt.models import COMMANDS, Answer, EpisodeLife, EpisodeSteps, Presence
from robotouille_server.mqtt.topics import Topics

__all__ = ["document"]

SERVER = {"server": {"description": "The server's name (`mqtt_name`)."}}
EPISODE = {**SERVER, "episode": {"description": "The episode's id."}}
TOPICS = Topics("{server}")

SENT: dict[str, tuple[str, type[BaseModel], dict[str, Any], int, bool]] = {
    "presence": (TOPICS.presence, Presence, SERVER, 1, True),
    "life": (TOPICS.life("{episode}"), EpisodeLife, EPISODE, 1, False),
    "steps": (TOPICS.steps("{episode}"), EpisodeSteps, EPISODE, 0, False),
    "answers": (TOPICS.answers, Answer, SERVER, 1, False),
}
"""By channel: topic, message, parameters, quality of service, whether it is retained."""


def document() -> dict[str, Any]:
    """The document, as the server sees it."""
    models = (*(row[1] for row in SENT.values()), *COMMANDS)
    template = "#/components/schemas/{model}"
    _, found = models_json_schema([(m, "validation") for m in models], ref_template=template)
    channels = {
        name: _channel(topic, (model,), parameters)
        for name, (topic, model, parameters, _, _) in SENT.items()
    }
    channels["commands"] = _channel(TOPICS.commands, COMMANDS, SERVER)
    operations = {
        f"send-{name}": _operation("send", name, qos, retain=retain)
        for name, (_, _, _, qos, retain) in SENT.items()
    }
    operations["receive-commands"] = {
        **_operation("receive", "commands", 1, retain=False),
        "reply": {"channel": {"$ref": "#/channels/answers"}},
    }
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "Robotouille over MQTT",
            "version": "1.0.0",
            "description": "What servers tell an MQTT broker, and what they may be asked for. "
            "See mqtt.md for what schemas cannot say.",
        },
        "defaultContentType": "application/json",
        "servers": {
            "broker": {
                "host": "127.0.0.1:1883",
                "protocol": "mqtt",
                "protocolVersion": "5.0",
                "bindings": {"mqtt": {"lastWill": _last_will()}},
            }
        },
        "channels": channels,
        "operations": operations,
        "components": {
            "messages": {model.__name__: _message(model) for model in models},
            "schemas": found["$defs"],
        },
    }


def _last_will() -> dict[str, Any]:
    return {
        "topic": TOPICS.presence,
        "qos": 1,
        "message": '{"state":"gone"}',
        "retain": True,
    }


def _channel(
    topic: str, models: tuple[type[BaseModel], ...], parameters: dict[str, Any]
) -> dict[str, Any]:
    return {
        "address": topic,
        "parameters": parameters,
        "messages": {m.__name__: {"$ref": f"#/components/messages/{m.__name__}"} for m in models},
    }


def _operation(action: str, channel: str, qos: int, *, retain: bool) -> dict[str, Any]:
    return {
        "action": action,
        "channel": {"$ref": f"#/channels/{channel}"},
        "bindings": {"mqtt": {"qos": qos, "retain": retain}},
    }


def _message(model: type[BaseModel]) -> dict[str, Any]:
    return {
        "name": model.__name__,
        "summary": " ".join((model.__doc__ or "").split()),
        "payload": {"$ref": f"#/components/schemas/{model.__name__}"},
    }
