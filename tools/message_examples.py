"""One example of every message of the wire protocol, for the documentation and the tests."""

from __future__ import annotations

import json
from typing import Any

from robotouille.episode import Absence, Clock, Controller, PauseReason, Phase, Reason
from robotouille.protocol import messages as m
from robotouille.protocol.codec import JSON
from robotouille.protocol.error_codes import ErrorCode
from robotouille.world.presentation.signals import Intent
from robotouille.world.unmet import UnmetKind

__all__ = ["EXAMPLES"]

EPISODE, CODE = "ad9ac0c99d4665c2", "KQXZB-WMFTA"
RESUME = "eyJhbGciOiJIUzI1NiIs…"
PICTURE = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"
HASH = "80e883585e6c302859ed6dda38297ffd"

SENT = (
    m.Hello(protocol=1, name="ada", kind="bot"),
    m.ListEpisodes(ref=1),
    m.Create(
        ref=2,
        task="multi_agent/10@3",
        clock=Clock.REALTIME,
        step_rate=8.0,
        absence=Absence.PAUSE,
        grace=60.0,
        open_for=604800.0,
        labels={"condition": "bot", "pair": "p7"},
    ),
    m.Close(ref=9, episode=CODE),
    m.Join(ref=3, episode=CODE, seat="robot2", view="both"),
    m.Ready(),
    m.Leave(ref=4),
    m.Act(
        seq=7,
        action=m.NamedAction(name="move", args=["robot1", "table1", "stove1"]),
        basis=12,
        max_age=2,
        think_ms=850,
    ),
    m.Say(text="I take the stove"),
    m.Signal(intent=Intent.NEED, target="stove1"),
    m.Note(topic="model-call", text='{"number": 1, "answer": "Reasoning: It is near.', more=True),
    m.GetRendering(ref=10),
    m.GetPicture(ref=11, digest=PICTURE),
    m.Resync(),
)
RECEIVED = (
    m.Welcome(
        protocol=1,
        server="robotouille 0.1.0",
        session="aba0e01e30731b84",
        resume=RESUME,
        role="host",
        grace=30.0,
        readiness=True,
        workers=[m.WorkerAddress(port=8766), m.WorkerAddress(port=8767)],
        nodes=["wss://node2.kitchen.example.org"],
    ),
    m.Episodes(
        ref=1,
        episodes=[
            m.EpisodeInfo(
                episode=EPISODE,
                code=CODE,
                task="synchronous/01_cheese_sandwich",
                clock=Clock.LOCKSTEP,
                phase=Phase.WAITING,
                step=0,
                max_steps=500,
                seats=[m.SeatInfo(player="robot1")],
            )
        ],
        total=1,
    ),
    m.Created(ref=2, episode=EPISODE, code=CODE),
    m.Closed(ref=9, episode=EPISODE),
    m.Rendering(
        ref=10,
        rendering={"version": "2.0"},
        bindings={},
        pictures={"egg.png": PICTURE},
        stars=[86, 113],
    ),
    m.Picture(ref=11, digest=PICTURE, data="iVBORw0KGgo…"),
    m.Joined(
        ref=3,
        episode=EPISODE,
        code=CODE,
        role="player",
        seat="robot2",
        name="ada 2",
        resume=RESUME,
    ),
    m.Moved(ref=3, episode="01b6c77abbe4d2bf", port=8767),
    m.Snapshot(
        episode=EPISODE,
        step=4,
        phase=Phase.RUNNING,
        digest="5133f75b66e679561d8387157b5acb75",
        predicates=["iscooking", "loc", "item_on"],
        objects=[
            ["stove1", "stove", "station"],
            ["table1", "table", "station"],
            ["patty1", "patty", "item"],
            ["robot1", "robot", "player"],
        ],
        atoms=[[0, 2], [1, 3, 0], [1, 3, 1], [2, 2, 0], [2, 2, 1]],
        facts=[0, 2, 3],
        timers=[["cook.0(patty1,stove1)", [1, 2]]],
        busy={},
        hash=HASH,
        seat="robot1",
        seq=4,
        clock={
            "clock": Clock.LOCKSTEP,
            "step_rate": 5.0,
            "move_budget": None,
            "max_steps": 500,
            "thinking": "wall",
            "grace": 30.0,
            "absence": Absence.WAIT,
        },
        said=2,
        seats=[
            m.SeatInfo(
                player="robot1",
                name="ada",
                kind="bot",
                present=True,
                controller=Controller.BOT,
                acted=4,
            )
        ],
    ),
    m.Delta(
        step=5,
        add=[1],
        remove=[2],
        timers={"cook.0(patty1,stove1)": [1, 3]},
        did=[[0, "move", "robot1", "table1", "stove1"]],
        seq=[5],
    ),
    m.Observation(
        episode=EPISODE,
        step=0,
        phase=Phase.WAITING,
        seat="robot1",
        text="You are robot1.\n\nStation table1:\ntable1 is a table\n\n"
        "Valid Actions:\nDo nothing\n\nGoal: Make a cheese sandwich on a table.",
        actions=["Do nothing"],
    ),
    m.Rejected(
        seq=6,
        step=12,
        action="Start cooking patty1 at stove1 with robot1",
        reasons=["needs: robot1 stands at stove1"],
        why=[m.Why(kind=UnmetKind.CONDITION, predicate="loc", objects=["robot1", "stove1"])],
    ),
    m.Said(step=12, number=3, name="ada", seat="robot1", text="I take the stove"),
    m.Told(seat="robot1", text="planner 2"),
    m.Notice(text="The server closes in five minutes."),
    m.Roster(
        phase=Phase.PAUSED,
        pause=m.Pause(reason=PauseReason.ABSENCE, left=24.5),
        seats=[
            m.SeatInfo(
                player="robot1", name="ada", kind="bot", present=True, controller=Controller.BOT
            ),
            m.SeatInfo(player="robot2", name="bob", kind="human", controller=Controller.ABSENT),
        ],
        spectators=1,
        spectator_names=["eva"],
    ),
    m.Ended(
        step=41,
        outcome={
            "reason": Reason.GOAL,
            "steps": 41,
            "seconds": 63.2,
            "detail": "",
            "seats": [
                {
                    "player": "robot1",
                    "acted": 30,
                    "busy": 8,
                    "waiting": 1,
                    "idle": 2,
                    "away": 0,
                    "substituted": 0,
                    "rejected": 1,
                    "invalid": 1,
                    "malformed": 0,
                    "said": 0,
                }
            ],
        },
        hash=HASH,
    ),
    m.Left(ref=4, episode=EPISODE),
    m.Error(ref=3, code=ErrorCode.SEAT_TAKEN, message="robot2 is played by bob", field="seat"),
    m.Bye(reason="the server is restarting", code=ErrorCode.SERVER_RESTART, retry=True),
)

EXAMPLES: dict[str, dict[str, Any]] = {
    message.type: json.loads(JSON.encode(message)) for message in (*SENT, *RECEIVED)
}
"""Messages as plain JSON values, by type."""
