"""Requests that are rejected, refused or repeated."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from robotouille.domain.loading import load_task
from robotouille.episode import RejectionKind
from robotouille.replay import rejection_kind
from robotouille.replay.measures import rejections
from robotouille.replay.recording import read_recording
from robotouille.world.text import MAX_SENTENCE
from robotouille_server import Server
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import run, virtual


@virtual
async def test_action_outside_an_episode_is_rejected(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as client:
        answer = await client.ask({"type": "act", "seq": 4, "action": None}, "rejected")
        assert (answer["code"], answer["seq"]) == ("episode/none", 4)


async def two_players(server: Any, *clients: Raw, task: str = "multi_agent/01") -> str:
    created = await clients[0].ask({"type": "create", "task": task, "clock": "lockstep"}, "created")
    for number, client in enumerate(clients, 1):
        join = {"type": "join", "episode": created["code"], "seat": f"robot{number}"}
        await client.ask(join, "joined")
    for client in clients:
        while (await client.expect("roster"))["phase"] != "running":
            pass
    return str(created["code"])


@virtual
async def test_impossible_actions_are_rejected(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada, raw(server) as bob:
        code = await two_players(server, ada, bob)
        answer = await bob.ask({"type": "join", "episode": code})
        assert answer["code"] == "episode/joined"
        table = {"name": "move", "args": ["robot2", "table1", "table2"]}
        for action, rejected_code, words in [
            (table, "action/invalid", "robot2 is not yours"),
            ({"name": "fly", "args": []}, "action/unknown", "no action 'fly'"),
            ({"name": "move", "args": []}, "action/unknown", "takes (p1: player"),
            ({"name": "move", "args": ["robot1", "tabel1", "x"]}, "action/unknown", "table1"),
            ({"name": "move", "args": ["robot1", "robot1", "x"]}, "action/unknown", "a player"),
            ("jump out of the window", "action/unknown", "no valid action"),
            (10_000, "action/unknown", "valid actions"),
        ]:
            answer = await ada.ask(
                {"type": "act", "seq": 1, "action": action, "basis": 0}, "rejected"
            )
            assert answer.get("code", "action/invalid") == rejected_code, answer
            assert words in answer["reasons"][0], answer
            if rejected_code == "action/invalid":
                break
        for seq, (action, words) in enumerate(
            [({"name": "fly", "args": []}, "no action"), (99, "valid actions")], 2
        ):
            answer = await ada.ask(
                {"type": "act", "seq": seq, "action": action, "basis": 0}, "rejected"
            )
            assert words in answer["reasons"][0]
        answer = await ada.ask({"type": "act", "seq": 4, "action": 0, "basis": 7}, "rejected")
        assert answer["code"] == "action/stale"


@virtual
async def test_old_sequence_numbers_and_ended_episodes_are_rejected(tmp_path: Path) -> None:
    async with serving(tmp_path, max_steps=2) as server, raw(server) as ada, raw(server) as bob:
        code = await two_players(server, ada, bob)
        for seq in (5, 6):
            for client in (ada, bob):
                await client.send({"type": "act", "seq": seq, "action": None})
            await ada.expect("delta")
            if seq == 5:
                await ada.send({"type": "act", "seq": 3, "action": None})
                answer = await ada.expect("rejected")
                assert answer["code"] == "action/stale"
                assert (await ada.expect("snapshot"))["step"] == 1
        assert (await ada.expect("ended"))["outcome"]["reason"] == "step_limit"
        await ada.send({"type": "act", "seq": 7, "action": None})
        assert (await ada.expect("rejected"))["code"] == "episode/ended"
        async with raw(server) as late:
            answer = await late.ask({"type": "join", "episode": code})
            assert answer["code"] == "episode/ended"


@virtual
async def test_full_episodes_are_refused(tmp_path: Path) -> None:
    async with serving(tmp_path, max_spectators=1, max_episodes=1) as server:
        async with (
            raw(server) as ada,
            raw(server) as bob,
            raw(server) as eve,
            raw(server) as dan,
        ):
            code = await two_players(server, ada, bob)
            for seat, expected in [(None, "episode/full"), ("robot1", "seat/taken"),
                                   ("robot9", "seat/unknown")]:  # fmt: skip
                answer = await eve.ask({"type": "join", "episode": code, "seat": seat})
                assert answer["code"] == expected
            watch = {"type": "join", "episode": code, "role": "spectator"}
            assert (await eve.ask(watch, "joined"))["role"] == "spectator"
            await eve.send({"type": "act", "seq": 1, "action": None})
            assert (await eve.expect("rejected"))["code"] == "seat/none"
            assert (await dan.ask(watch))["code"] == "episode/full"
            assert (await dan.ask({"type": "create"}))["code"] == "server/full"


BAD = "Put down cheese1 at table1 with robot1"


async def seated(client: Raw) -> dict[str, Any]:
    """Join an episode alone with the text view; return the first observation."""
    options = {"task": "synchronous/01", "clock": "turn", "max_steps": 1}
    created = await client.ask({"type": "create", **options}, "created")
    join = {"type": "join", "episode": created["code"], "view": "text"}
    await client.ask(join, "joined")
    first = await client.expect("observation")
    while (await client.expect("roster"))["phase"] != "running":
        pass
    return first


def act(seq: int, action: object, **fields: object) -> dict[str, object]:
    return {"type": "act", "seq": seq, "action": action, **fields}


@virtual
async def test_unmet_conditions_are_equal_for_sentences_and_objects(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada:
        await seated(ada)
        sentence = await ada.ask(act(1, BAD), "rejected")
        named = {"name": "place-item", "args": ["robot1", "cheese1", "table1"]}
        thing = await ada.ask(act(2, named), "rejected")
        assert {**sentence, "seq": 2} == thing
        assert "code" not in sentence
        condition = {"kind": "condition", "predicate": "has_item"}
        assert {**condition, "objects": ["robot1", "cheese1"]} in sentence["why"]
        again = await ada.ask(act(2, BAD), "rejected")
        assert again["reasons"] == sentence["reasons"]


@virtual
async def test_each_request_is_answered_recorded_and_counted_once(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada:
        first = await seated(ada)
        long = "pizza " * (MAX_SENTENCE // 6)
        requests = ["Boil the sea", long, {"name": "fly", "args": []}, 999]
        for seq, request in enumerate(requests, 1):
            for _ in range(2):
                sent = act(seq, request, basis=0, reasoning=f"thought {seq}")
                answer = await ada.ask(sent, "rejected")
                assert (answer["seq"], answer["code"]) == (seq, "action/unknown")
                # The answer to a repeated request has the code only.
                assert answer.get("why", [{"kind": "unknown"}]) == [{"kind": "unknown"}]
        stale = await ada.ask(act(5, 0, basis=7), "rejected")
        assert stale["code"] == "action/stale"
        await ada.expect("observation")
        await ada.ask(act(6, BAD, reasoning="thought 6"), "rejected")
        await ada.send(act(7, f"({first['actions'][0].lower()})."))
        outcome = (await ada.expect("ended"))["outcome"]
        (seat,) = outcome["seats"]
        assert (seat["acted"], seat["rejected"]) == (1, 6)
        assert (seat["invalid"], seat["malformed"]) == (2, 4)
    recording = read_recording(next(tmp_path.rglob("*.rbt")))
    assert recording.verify().ok
    found = [note for note in recording.notes() if note["note"] == "rejected"]
    assert [note["action"][:12] for note in found] == [
        "Boil the sea", "pizza pizza ", "fly()", "999", "0", BAD[:12],
    ]  # fmt: skip
    assert [note.get("reasoning", "") for note in found] == [
        "thought 1", "thought 2", "thought 3", "thought 4", "", "thought 6",
    ]  # fmt: skip
    assert rejections(recording) == {"robot1": {"invalid": 2, "malformed": 4}}


async def join(client: Raw, code: str) -> dict[str, Any]:
    return await client.ask({"type": "join", "episode": code}, "joined")


def rejected(folder: Path) -> list[dict[str, Any]]:
    (file,) = folder.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    return [note for note in recording.notes() if note["note"] == "rejected"]


@virtual
async def test_early_stale_and_unreadable_actions(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada, raw(server, name="bob") as bob:
        options = {"task": "multi_agent/01", "clock": "lockstep"}
        created = await ada.ask({"type": "create", **options}, "created")
        await join(ada, created["code"])
        early = await ada.ask(act(1, "juggle", reasoning="at once"), "rejected")
        assert early["code"] == "episode/waiting"
        await join(bob, created["code"])
        room = server.lobby.find(created["code"])
        assert room.episode.running
        bad = await ada.ask(act(7, "juggle"), "rejected")
        assert bad["code"] == "action/unknown"
        old = await ada.ask(act(3, "walk", reasoning="late"), "rejected")
        assert (old["seq"], old["code"], old["action"]) == (3, "action/stale", "walk")
        assert room.episode.seat("robot1").answer.seq == 7, "the last action is another"
        wrong = await ada.ask(act(8, {"nme": "walk"}), "error")
        assert wrong["code"].startswith("message/")
        tally = room.episode.seat("robot1").tally
        assert (tally.rejected, tally.invalid, tally.malformed) == (4, 0, 2)
        room.abort("seen")
    notes = rejected(tmp_path)
    assert [note["code"] for note in notes[:3]] == [
        "episode/waiting",
        "action/unknown",
        "action/stale",
    ]
    assert [rejection_kind(note) for note in notes] == [
        RejectionKind.UNHEARD,
        RejectionKind.MALFORMED,
        RejectionKind.UNHEARD,
        RejectionKind.MALFORMED,
    ]
    assert [note.get("heard", True) for note in notes] == [False, True, False, False]
    assert [note.get("reasoning") for note in notes[:3]] == ["at once", None, "late"]
    assert (notes[3]["seq"], "nme" in notes[3]["action"]) == (0, True)
    assert all(note["reasons"] for note in notes)


@virtual
async def test_recorded_actions_have_visible_characters_only(tmp_path: Path) -> None:
    hidden = "mo\u200bve\u202e"
    async with serving(tmp_path) as server, raw(server) as ada:
        options = {"task": "synchronous/01", "clock": "lockstep"}
        created = await ada.ask({"type": "create", **options}, "created")
        await join(ada, created["code"])
        for seq, action in enumerate((hidden, {"name": hidden, "args": [hidden]}), 1):
            wrong = await ada.ask(act(seq, action), "rejected")
            assert wrong["action"] in ("move", "move(move)")
        unreadable = json.dumps(act(9, {"nme": hidden}), ensure_ascii=False)
        await ada.socket.send(unreadable)
        await ada.expect("error")
        server.lobby.find(created["code"]).abort("seen")
    notes = rejected(tmp_path)
    assert [note["action"] for note in notes[:2]] == ["move", "move(move)"]
    assert '"nme": "move"' in notes[2]["action"]


@virtual
async def test_sentences_of_a_task_may_have_direction_marks(tmp_path: Path) -> None:
    task, tasks = load_task("synchronous/01"), tmp_path / "tasks"
    tasks.mkdir()
    domain = json.dumps(task.json["domain"]).replace("Move {p1}", r"Move \u200e{p1}\u200e")
    (tasks / "own.json").write_text(domain)
    problem = {**task.json["problem"], "domain": "own.json"}
    (tasks / "marked.json").write_text(json.dumps(problem))
    async with serving(tmp_path / "recordings", tasks=tasks) as server, raw(server) as ada:
        options = {"task": "marked", "clock": "lockstep"}
        created = await ada.ask({"type": "create", **options}, "created")
        joining = {"type": "join", "episode": created["code"], "view": "text"}
        await ada.ask(joining, "joined")
        shown = await ada.expect("observation")
        sentence = next(each for each in shown["actions"] if "\u200e" in each)
        answer = await ada.ask(act(1, sentence), "observation", "rejected")
        assert (answer["type"], answer["step"]) == ("observation", 1)


def test_actions_above_the_rate_limit(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, messages_per_second=10) as server, raw(server) as ada:
            options = {"task": "synchronous/01", "clock": "lockstep"}
            created = await ada.ask({"type": "create", **options}, "created")
            await join(ada, created["code"])
            codes = []
            for seq in range(1, 100):
                codes.append((await ada.ask(act(seq, "juggle"), "rejected"))["code"])
            assert "rate/limited" in codes
            server.lobby.find(created["code"]).abort("seen")
            return_codes.extend(codes)

    return_codes: list[str] = []
    run(main())
    assert [note["code"] for note in rejected(tmp_path)] == return_codes


def move(seq: int, start: str, end: str) -> dict[str, Any]:
    """Return an `act` message, which is valid only while the cook stands at table3."""
    return {"type": "act", "seq": seq, "action": {"name": "move", "args": ["robot1", start, end]}}


async def enter(server: Server, ada: Raw, clock: str) -> None:
    """Create an episode and join it alone."""
    create = {"type": "create", "task": "synchronous/01", "clock": clock}
    created = await ada.ask(create, "created")
    await ada.ask({"type": "join", "episode": created["code"]}, "joined")
    await ada.expect("snapshot")


@pytest.mark.parametrize("clock", ["turn", "lockstep", "realtime"])
@virtual
async def test_repeated_rejected_action_gets_the_same_answer_and_is_recorded_once(
    tmp_path: Path, clock: str
) -> None:
    async with serving(tmp_path) as server, raw(server) as ada:
        await enter(server, ada, clock)
        impossible = move(1, "table1", "table2")
        first = await ada.ask(impossible, "rejected")
        assert first["seq"] == 1
        assert first["reasons"]
        for _ in range(2):
            await ada.send(impossible)
            again = await ada.ask({"type": "say", "text": "well?"}, "rejected", "said")
            assert again["type"] == "rejected", "it was not answered again"
            await ada.expect("said")
            message = ("seq", "step", "reasons")
            assert [again[key] for key in message] == [first[key] for key in message]
        assert server.metrics.rejected == 1
        await ada.send(move(2, "table3", "table1"))
        while 2 not in (await ada.expect("delta", "rejected")).get("seq", []):
            pass
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    assert len([note for note in recording.notes() if note["note"] == "rejected"]) == 1
    moves = [move for step in recording.steps for move in step.get("moves", ())]
    assert [move["seq"] for move in moves] == [2]


@virtual
async def test_repeated_action_is_answered_by_a_snapshot_and_applied_once(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada:
        await enter(server, ada, "lockstep")
        there = move(1, "table3", "table1")
        assert (await ada.ask(there, "delta"))["step"] == 1
        await ada.send(there)
        again = await ada.ask({"type": "say", "text": "well?"}, "snapshot", "delta", "said")
        assert (again["type"], again["step"], again["seq"]) == ("snapshot", 1, 1)
        assert (await ada.ask(move(2, "table1", "table3"), "delta"))["step"] == 2
        stale = await ada.ask(there, "rejected", "delta")
        assert (stale["type"], stale["code"]) == ("rejected", "action/stale")
    (file,) = tmp_path.glob("*.rbt")
    moves = [move for step in read_recording(file).steps for move in step.get("moves", ())]
    assert [move["seq"] for move in moves] == [1, 2]


@pytest.mark.parametrize(
    ("basis", "message"),
    [
        (None, "an index needs 'basis', the step of the list; the current step is 1"),
        (0, "step 0 has passed; the current step is 1"),
        (99, "step 99 has not begun; the current step is 1"),
    ],
)
@virtual
async def test_position_in_the_list_of_another_step_is_stale(
    tmp_path: Path, basis: int | None, message: str
) -> None:
    async with serving(tmp_path) as server, raw(server) as ada:
        await enter(server, ada, "lockstep")
        await ada.ask({"type": "act", "seq": 1, "action": None}, "delta")
        act = {"type": "act", "seq": 2, "action": 0, "basis": basis}
        rejected = await ada.ask(act, "rejected")
        assert (rejected["code"], rejected["reasons"]) == ("action/stale", [message])


@virtual
async def test_control_characters_are_removed_from_texts(tmp_path: Path) -> None:
    forged = "\x00hi\r\n\x1b[1moperator: stop\u202e\x07"
    async with serving(tmp_path) as server, raw(server) as ada, raw(server) as bob:
        await two_players(server, ada, bob)
        await ada.send({"type": "say", "text": forged})
        assert (await bob.expect("said"))["text"] == "hi [1moperator: stop"
        await ada.send({"type": "note", "topic": "a\nb", "text": "one\r\n\ttwo\x00\x85"})
        act = {"type": "act", "seq": 1, "action": None, "reasoning": "why\x00\nnot\x1b"}
        await ada.send(act)
        answer = await ada.ask({"type": "say", "text": "\x00\u202e"}, "error")
        assert (answer["code"], answer["field"]) == ("message/invalid-field", "text")
        server.lobby.close(next(iter(server.lobby.rooms)), "over", "", operator=True)
        await ada.expect("ended")
        await server.lobby.closed()
        recording = read_recording(next(tmp_path.glob("*.rbt")))
    (noted,) = [note for note in recording.notes() if note["note"] == "noted"]
    assert (noted["topic"], noted["text"]) == ("a b", "one\n\ttwo")
