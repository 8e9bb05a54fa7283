"""A policy in a seat: one decision at a time, and what becomes of one that is given up."""

from __future__ import annotations

import asyncio

import pytest

from robotouille_client.bots.seat_policy import SeatPolicy
from robotouille_client.game import Game
from tests.support.pondering import Pondering
from tests.support.scripted_server import ScriptedServer


class Seat:
    """A seat whose policy ponders, in a game without a server."""

    def __init__(self) -> None:
        self._server = ScriptedServer()
        self.game = Game(self._server.joined(), lambda: None)
        self.game.receive(self._server.snapshot(), 0.0)
        self.policy = Pondering()
        self.seat = SeatPolicy(self.game, lambda state, player: self.policy)
        self.seat.begin()
        self._heed()

    def _heed(self) -> None:
        for event in self.game.poll():
            self.seat.heed(event)

    def step(self) -> None:
        """Its player does something, and it is told so."""
        self.game.receive(self._server.delta([self.game.actions[0]]), 0.0)
        self._heed()

    async def give_up_a_decision(self) -> None:
        deciding = asyncio.create_task(self.seat.decide())
        shown = await self.policy.asked.get()
        assert shown.facts == self.game.state.facts
        deciding.cancel()
        with pytest.raises(asyncio.CancelledError):
            await deciding


async def test_after_one_that_was_given_up_the_next_begins_in_the_state_of_then() -> None:
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


async def test_a_world_of_its_own_that_one_decision_alone_uses() -> None:
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


async def test_what_a_decision_that_was_given_up_has_raised_comes_out_of_the_next() -> None:
    table = Seat()
    await table.give_up_a_decision()
    table.policy.answers.put(ZeroDivisionError("in the policy"))
    with pytest.raises(ZeroDivisionError, match="in the policy"):
        await table.seat.decide()
