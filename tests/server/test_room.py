"""A room beside its episode: how old deltas are when they are sent, and who is told who watches."""

from __future__ import annotations

import asyncio
from pathlib import Path

from prometheus_client.parser import text_string_to_metric_families

from robotouille_client import connect
from robotouille_server import Server
from robotouille_server.rooms.broadcast.spectator_rosters import ROSTER_SECONDS
from tests.support.disks import TroubledFolder
from tests.support.servers import serving
from tests.support.virtual_time import VirtualTimeLoop, run

WRITING = 0.3


class SlowDisk(TroubledFolder):
    """A folder in which each append takes its time, once it is slow."""

    slow = False

    def before_append(self, name: str) -> None:
        if self.slow:
            pass_time(WRITING)


def pass_time(seconds: float) -> None:
    """Nothing else happens meanwhile: the process waits for its disk."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop._jumping.now += seconds


def ages(server: Server) -> tuple[float, float]:
    """How many deltas were sent, and their ages in seconds together."""
    for family in text_string_to_metric_families(server.metrics.page().decode()):
        if family.name == "robotouille_delta_age_seconds":
            values = {sample.name: sample.value for sample in family.samples}
            return values[f"{family.name}_count"], values[f"{family.name}_sum"]
    raise AssertionError("there is no such metric")


def test_a_delta_is_as_old_as_its_step_when_it_is_sent(tmp_path: Path) -> None:
    async def main() -> None:
        disk = SlowDisk(tmp_path)
        async with (
            serving(tmp_path, storage=disk) as server,
            connect(server.url, name="ada") as ada,
        ):
            game = await ada.join((await ada.create("synchronous/01")).code)
            for _ in range(3):
                await game.act(game.actions[0])
            count, total = ages(server)
            assert count == 3
            assert total < WRITING, "nothing has taken any time yet"
            disk.slow = True
            for _ in range(3):
                await game.act(game.actions[0])
            later_count, later_total = ages(server)
            assert later_count == 6
            assert 3 * WRITING <= later_total - total + 1e-6 < 3 * WRITING + 0.1
            disk.slow = False

    run(main())


def test_who_watches_is_told_also_when_a_connection_is_lost_and_back(tmp_path: Path) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            connect(server.url, name="ada") as ada,
            connect(server.url, name="eve") as eve,
            connect(server.url, name="zoe") as zoe,
        ):
            game = await ada.join((await ada.create("multi_agent/01")).code)
            for one in (eve, zoe):
                await one.join(game.code, role="spectator")
            await asyncio.sleep(2 * ROSTER_SECONDS)
            assert game.spectator_names == ("eve", "zoe")
            game.poll()
            for session in server.lobby.find(game.code).members[1:]:
                assert session.peer is not None
                session.peer.drop("test")
            await asyncio.sleep(0.1)
            assert (game.spectators, len(game.poll())) == (0, 1), "both at once, in one roster"
            await asyncio.sleep(5)
            assert game.spectator_names == ("eve", "zoe")

    run(main())
