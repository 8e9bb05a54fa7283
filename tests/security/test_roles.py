"""Roles and their permissions."""

from __future__ import annotations

import pytest

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.world.presentation.signals import Intent
from robotouille_server.auth.roles import (
    PERMISSIONS,
    Role,
    check_join,
    check_permission,
    same_episode,
)

EXAMPLES: list[messages.ClientMessage] = [
    messages.Hello(protocol=1, name="x"),
    messages.ListEpisodes(),
    messages.Create(),
    messages.Join(episode="x"),
    messages.Join(episode="x", role="spectator"),
    messages.Ready(),
    messages.Leave(),
    messages.Act(seq=1, action=None),
    messages.Say(text="x"),
    messages.Signal(intent=Intent.WAIT),
    messages.Note(topic="x", text="x"),
    messages.GetRendering(),
    messages.GetPicture(digest="0" * 64),
    messages.Close(episode="x"),
    messages.Resync(),
]
REFUSED: dict[Role, set[str]] = {
    Role.OPERATOR: set(),
    Role.HOST: set(),
    Role.PLAYER: {"list", "create", "close"},
    Role.SPECTATOR: {
        "list", "create", "close", "ready", "act", "say", "signal", "note", "join as player",
    },
}  # fmt: skip


def label(message: messages.ClientMessage) -> str:
    if isinstance(message, messages.Join):
        return f"join as {message.role}"
    return message.type


@pytest.mark.parametrize("role", Role)
def test_each_role_may_send_its_messages(role: Role) -> None:
    refused = set()
    for message in EXAMPLES:
        try:
            check_permission(role, message)
        except ProtocolError as error:
            refused.add(label(message))
            assert error.code == "auth/role"
            assert error.field == ("role" if message.type == "join" else "type")
    assert refused == REFUSED[role]


def test_every_message_type_has_permissions() -> None:
    assert {message.type for message in EXAMPLES} == PERMISSIONS[Role.OPERATOR]
    assert set(PERMISSIONS) == set(Role)


def test_roles_include_lower_roles() -> None:
    order = [Role.OPERATOR, Role.HOST, Role.PLAYER, Role.SPECTATOR]
    for i, one in enumerate(order):
        for j, other in enumerate(order):
            assert one.includes(other) == (i <= j)
            assert (PERMISSIONS[one] >= PERMISSIONS[other]) >= one.includes(other)


def test_refusal_names_the_required_role() -> None:
    with pytest.raises(ProtocolError, match=r"a player may not send 'create'.*the role host"):
        check_permission(Role.PLAYER, messages.Create())
    with pytest.raises(ProtocolError, match=r"a spectator may not send 'act'.*the role player"):
        check_permission(Role.SPECTATOR, messages.Act(seq=1, action=None))


ROOM = {"episode": "ad9ac0c99d4665c2", "code": "QWERTYUPAS"}


def test_token_for_an_episode_opens_no_other() -> None:
    join = messages.Join(episode="whatever")
    for only in ("", "ad9ac0c99d4665c2", "QWERTYUPAS", "qwert-yupas"):
        assert check_join(join, only=only, seat="", **ROOM) is None
    for only in ("ad9ac0c99d4665c3", "QWERTYUPA", "-", " "):
        with pytest.raises(ProtocolError) as caught:
            check_join(join, only=only, seat="", **ROOM)
        assert (caught.value.code, caught.value.field) == ("auth/episode", "episode")


def test_token_for_a_seat_requests_that_seat() -> None:
    anywhere = messages.Join(episode="x")
    right = messages.Join(episode="x", seat="robot2")
    wrong = messages.Join(episode="x", seat="robot1")
    watching = messages.Join(episode="x", role="spectator")
    assert check_join(anywhere, only="", seat="robot2", **ROOM) == "robot2"
    assert check_join(right, only="", seat="robot2", **ROOM) == "robot2"
    assert check_join(wrong, only="", seat="", **ROOM) == "robot1"
    assert check_join(watching, only="", seat="robot2", **ROOM) is None
    with pytest.raises(ProtocolError, match="your token is for the seat robot2") as caught:
        check_join(wrong, only="", seat="robot2", **ROOM)
    assert (caught.value.code, caught.value.field) == ("auth/seat", "seat")


def test_token_for_a_seat_refuses_other_seats() -> None:
    alone = messages.Join(episode="x", seats=["robot2"])
    assert check_join(alone, only="", seat="robot2", **ROOM) == "robot2"
    several = [messages.Join(episode="x", seats=seats) for seats in ("all", ["robot2", "robot1"])]
    for join in several:
        assert check_join(join, only="", seat="", **ROOM) is None
        with pytest.raises(ProtocolError, match="for the seat robot2 only") as caught:
            check_join(join, only="", seat="robot2", **ROOM)
        assert (caught.value.code, caught.value.field) == ("auth/seat", "seats")


def test_codes_ignore_case_and_dashes() -> None:
    assert same_episode(" qwert-yupas ", "QWERTYUPAS")
    assert not same_episode("QWERTYUPAS", "QWERTYUPAZ")
