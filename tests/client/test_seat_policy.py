"""A policy in a seat: one decision at a time, and cancelled decisions."""

from __future__ import annotations

import asyncio

import pytest

from robotouille_client.bots import seat_policy
from robotouille_client.bots.seat_policy import SeatPolicy
from robotouille_client.game import Game
from tests.support.scripted_server import ScriptedServer
from tests.support.slow_policy import SlowPolicy


class Seat:
    """A seat with a slow policy, in a game without a server."""

    def __init__(self) -> None:
        self._server = ScriptedServer()
        self.game = Game(self._server.joined(), lambda: None)
        self.game.receive(self._server.snapshot(), 0.0)
        self.policy = SlowPolicy()
        self.seat = SeatPolicy(self.game, lambda state, player: self.policy)
        self.seat.begin()
        self._heed()

    def _heed(self) -> None:
        for event in self.game.poll():
            self.seat.heed(event)

    def step(self) -> None:
        """Take a step with an action of the seat's player."""
        self.game.receive(self._server.delta([self.game.actions[0]]), 0.0)
        self._heed()

    async def give_up_a_decision(self) -> None:
        deciding = asyncio.create_task(self.seat.decide())
        shown = await self.policy.asked.get()
        assert shown.facts == self.game.state.facts
        deciding.cancel()
        with pytest.raises(asyncio.CancelledError):
            await deciding


async def test_decision_after_a_cancelled_one_uses_the_current_state() -> None:
    table = Seat()
    await table.give_up_a_decision()
    table.step()
    deciding = asyncio.create_task(table.seat.decide())
    await asyncio.sleep(0)
    table.step()
    assert (table.policy.observed, table.policy.asked.qsize()) == ([], 0), "it searches still"
    unused, used = table.game.actions[:2]
    table.policy.answers.put(unused)
    shown = await table.policy.asked.get()
    assert shown.facts == table.game.state.facts
    assert len(table.policy.observed) == 2
    table.policy.answers.put(used)
    assert await deciding == used


async def test_policy_decides_on_its_own_copy_of_the_world() -> None:
    table = Seat()
    deciding = asyncio.create_task(table.seat.decide())
    shown = await table.policy.asked.get()
    assert shown.world is not table.game.world
    table.step()
    table.policy.answers.put(None)
    assert await deciding is None
    assert table.policy.observed == []
    table.step()
    assert len(table.policy.observed) == 2


async def test_exception_of_a_cancelled_decision_is_raised_by_the_next() -> None:
    table = Seat()
    await table.give_up_a_decision()
    table.policy.answers.put(ZeroDivisionError("in the policy"))
    with pytest.raises(ZeroDivisionError, match="in the policy"):
        await table.seat.decide()


async def test_events_during_a_long_decision_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seat_policy, "MAX_UNHEARD", 3)
    table = Seat()
    await table.give_up_a_decision()
    for _ in range(5):
        table.step()
    table.policy.answers.put(None)
    deciding = asyncio.create_task(table.seat.decide())
    shown = await table.policy.asked.get()
    assert shown.facts == table.game.state.facts
    assert len(table.policy.observed) == 3
    table.policy.answers.put(None)
    await deciding
