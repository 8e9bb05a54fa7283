"""AsyncAPI document of the MQTT topics, for docs/asyncapi-mqtt.json."""

from __future__ import annotations

import re
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from robotouille_server.mqtt.messages import (
    COMMANDS,
    CommandReply,
    EpisodeSteps,
    LifecycleEvent,
    Presence,
    Topics,
)

__all__ = ["mqtt_asyncapi"]

_TOPICS = Topics("{server}")
_CHANNELS: dict[str, tuple[str, tuple[type[BaseModel], ...], int, bool]] = {
    "presence": (_TOPICS.presence, (Presence,), 1, True),
    "life": (_TOPICS.life("{episode}"), (LifecycleEvent,), 1, False),
    "steps": (_TOPICS.steps("{episode}"), (EpisodeSteps,), 0, False),
    "answers": (_TOPICS.answers, (CommandReply,), 1, False),
    "ownAnswers": (_TOPICS.reply_topic(f"{_TOPICS.answers}/{{name}}"), (CommandReply,), 1, False),
    "commands": (_TOPICS.commands, COMMANDS, 1, False),
}
"""Topic, messages, quality of service and retain flag of each channel."""
_PARAMETERS = {
    "server": {"description": "Name of the server (`mqtt_name`)."},
    "episode": {"description": "Id of the episode."},
    "name": {"description": "Topic levels of the client's choice, such as its user name."},
}


def mqtt_asyncapi() -> dict[str, Any]:
    """Return the AsyncAPI 3.0 document, from the server's point of view."""
    channels: dict[str, Any] = {}
    operations: dict[str, Any] = {}
    for name, (topic, models, qos, retain) in _CHANNELS.items():
        channels[name] = {
            "address": topic,
            "parameters": {each: _PARAMETERS[each] for each in re.findall(r"\{(\w+)\}", topic)},
            "messages": {m.__name__: _ref("messages", m.__name__) for m in models},
        }
        action = "receive" if name == "commands" else "send"
        operations[f"{action}-{name}"] = {
            "action": action,
            "channel": {"$ref": f"#/channels/{name}"},
            "bindings": {"mqtt": {"qos": qos, "retain": retain}},
        }
    operations["receive-commands"]["reply"] = {"channel": {"$ref": "#/channels/answers"}}
    will = {"topic": _TOPICS.presence, "qos": 1, "message": '{"state":"gone"}', "retain": True}
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "Robotouille over MQTT",
            "version": "1.0.0",
            "description": "Messages that servers publish to an MQTT broker, and commands that "
            "they accept. mqtt.md describes what schemas cannot express.",
        },
        "defaultContentType": "application/json",
        "servers": {
            "broker": {
                "host": "127.0.0.1:1883",
                "protocol": "mqtt",
                "protocolVersion": "5.0",
                "bindings": {"mqtt": {"lastWill": will}},
            }
        },
        "channels": channels,
        "operations": operations,
        "components": _components(
            [model for _, models, _, _ in _CHANNELS.values() for model in models]
        ),
    }


def _components(models: list[type[BaseModel]]) -> dict[str, Any]:
    template = "#/components/schemas/{model}"
    _, found = models_json_schema([(m, "validation") for m in models], ref_template=template)
    described = {
        model.__name__: {
            "name": model.__name__,
            "summary": " ".join((model.__doc__ or "").split()),
            "payload": _ref("schemas", model.__name__),
        }
        for model in models
    }
    return {"messages": described, "schemas": found["$defs"]}


def _ref(kind: str, name: str) -> dict[str, str]:
    return {"$ref": f"#/components/{kind}/{name}"}
