"""What waits for the broker is bounded, and what is dropped is counted."""

from __future__ import annotations

import pytest

from robotouille_server.mqtt import outbox as module
from robotouille_server.mqtt.models import Presence
from robotouille_server.mqtt.outbox import Outbox, Outgoing, TakenStep
from robotouille_server.runtime.metrics import Metrics


def message(number: int) -> Outgoing:
    return Outgoing(str(number), Presence(state="online"))


def step(episode: str, number: int) -> TakenStep:
    return TakenStep(episode, number, 0, 0, ())


def test_messages_come_out_in_order_and_can_be_put_back() -> None:
    outbox = Outbox(Metrics())
    for number in range(5):
        outbox.add(message(number))
    taken = outbox.take(3)
    outbox.add(message(5))
    outbox.put_back(taken[1:])
    assert [each.topic for each in outbox.take(9)] == ["1", "2", "3", "4", "5"]


def test_the_oldest_are_dropped_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_MESSAGES", 3)
    monkeypatch.setattr(module, "MAX_STEPS", 3)
    metrics = Metrics()
    outbox = Outbox(metrics)
    for number in range(5):
        outbox.add(message(number))
        outbox.add_step(step("a" if number % 2 else "b", number))
    assert len(outbox) == 6
    assert (metrics.mqtt_dropped_messages, metrics.mqtt_dropped_steps) == (2, 2)
    assert [each.topic for each in outbox.take(2)] == ["2", "3"]
    outbox.add(message(5))
    outbox.add(message(6))
    outbox.put_back([message(2), message(3)])
    assert metrics.mqtt_dropped_messages == 4, "nothing that came later gives way"
    assert [each.topic for each in outbox.take(9)] == ["4", "5", "6"]
    assert {name: [s.step for s in steps] for name, steps in outbox.take_steps().items()} == {
        "b": [2, 4],
        "a": [3],
    }
    assert (outbox.take_dropped("a"), outbox.take_dropped("a"), outbox.take_dropped("b")) == (
        1,
        0,
        1,
    )
    assert len(outbox) == 0
