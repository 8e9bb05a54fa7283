"""A resume token gives back a seat; the role is the role token's, and ends with it."""

from __future__ import annotations

from pathlib import Path

from robotouille_server.auth.roles import Role
from tests.support.servers import raw, serving
from tests.support.virtual_time import run

HOUR = 3600.0


def test_a_role_is_not_prolonged_by_coming_back(tmp_path: Path) -> None:
    """A host's token of one hour: the seat lasts longer, the right to open episodes does not."""
    now = [1_800_000_000.0]

    async def main() -> None:
        async with serving(tmp_path, wall=lambda: now[0], require_token=True) as server:
            token = server.tokens.mint_role(Role.HOST, "carol", seconds=int(HOUR))
            hello = {"type": "hello", "protocol": 1, "name": "carol"}
            async with raw(server, hello=False) as one:
                welcome = await one.ask({**hello, "token": token}, "welcome")
                assert welcome["role"] == "host"
                created = await one.ask({"type": "create", "grace": 86400.0}, "created")
                joined = await one.ask({"type": "join", "episode": created["code"]}, "joined")
            resume = joined["resume"]
            for hours, role in [(0.5, "host"), (0.6, "player"), (20, "player"), (20, "player")]:
                now[0] += hours * HOUR
                async with raw(server, hello=False) as one:
                    welcome = await one.ask({**hello, "resume": resume}, "welcome")
                    assert (welcome["resumed"], welcome["role"]) == (True, role)
                    assert (await one.expect("joined"))["seat"] == joined["seat"]
                    answer = await one.ask({"type": "create"}, "created")
                    assert (answer.get("code") == "auth/role") is (role == "player")
                resume = welcome["resume"]

    run(main())
