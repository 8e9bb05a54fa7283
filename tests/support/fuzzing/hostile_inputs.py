"""Hostile bytes for every reader in `tests.support.fuzzing.targets`, by its name."""

from __future__ import annotations

import json
from collections.abc import Callable

from tests.support.fuzzing.adversary import Adversary
from tests.support.fuzzing.forgery import recording_bytes
from tests.support.fuzzing.specimens import FILE_KINDS, client_messages, files, server_messages

__all__ = ["HOSTILE_INPUTS"]


def _file(kind: str) -> Callable[[Adversary], bytes]:
    def make(adversary: Adversary) -> bytes:
        content = adversary.random.choice(files(kind))
        if kind == "plan" or adversary.random.random() < 0.3:
            return adversary.damaged(content)
        value = json.loads(content)
        for _ in range(adversary.random.choice((1, 1, 2))):
            value = adversary.inside(value)
        return json.dumps(value, default=repr).encode()

    return make


HOSTILE_INPUTS: dict[str, Callable[[Adversary], bytes]] = {
    "client-json": lambda a: a.json_text(a.message(client_messages())).encode(),
    "client-msgpack": lambda a: a.packed(a.message(client_messages())),
    "server-json": lambda a: a.json_text(a.message(server_messages())).encode(),
    "server-msgpack": lambda a: a.packed(a.message(server_messages())),
    "recording": recording_bytes,
    **{kind: _file(kind) for kind in FILE_KINDS},
}
"""Generator of input for each reader, mostly valid input with a fault."""
