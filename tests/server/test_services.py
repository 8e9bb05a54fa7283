"""What connections use of their server: tokens for seats, and its farewell."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille.protocol.messages import Create
from robotouille_server.conversation import ShutdownNotice
from tests.support.servers import raw, serving
from tests.support.virtual_time import run


def test_seats_have_tokens_of_those_who_are_to_have_them(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            room = server.lobby.create(Create(task="multi_agent/02"))
            services = server.services

            def subjects(owner: str, participants: dict[str, str]) -> list[str]:
                tokens = services.seat_tokens(room, participants, owner)
                grants = [services.tokens.check_role(token) for token in tokens.values()]
                assert {(grant.episode, grant.seat) for grant in grants} == {
                    (room.id, player) for player in room.world.players
                }
                return [grant.subject for grant in grants]

            named, unnamed = subjects("lab", {"robot1": "p7"})
            assert unnamed == f"{room.id}-2"
            assert named == subjects("lab", {"robot1": "p7"})[0], "the same in all of their games"
            assert named != subjects("another lab", {"robot1": "p7"})[0]
            assert "p7" not in named

    run(main())


@pytest.mark.parametrize(
    ("hand_over", "code", "retry"),
    [(True, "server/restart", True), (False, "server/stopped", False)],
)
def test_a_server_says_whether_it_comes_back(
    tmp_path: Path, hand_over: bool, code: str, retry: bool
) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada:
            await asyncio.sleep(0.1)
            (session,) = server.services.sessions.by_id.values()
            assert session.peer is not None
            ShutdownNotice("an update", hand_over).send(session.peer)
            bye = await ada.expect("bye")
            assert (bye["code"], bye.get("retry", False)) == (code, retry)
            assert bye["reason"] == "an update"

    run(main())
