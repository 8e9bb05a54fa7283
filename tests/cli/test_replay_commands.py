"""Output of the replay commands, including controllers, pauses and restarts."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from robotouille import World
from robotouille.episode import (
    Absence,
    ActionRequest,
    Clock,
    Episode,
    Event,
    PauseReason,
    Rules,
)
from robotouille.replay.compression import compress
from robotouille.replay.container import MAGIC, frame_ends, pack_frame, read_frames
from robotouille.replay.recorder import HeaderDetails, Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.restore import restore
from robotouille_client.cli.main import app
from tests.support.games import record, recorded_game

TASK = World("multi_agent/01")


def robotouille(*words: str) -> str:
    done = CliRunner().invoke(app, list(words))
    assert done.exit_code == 0, done.output
    return done.stdout


@pytest.fixture
def eventful(tmp_path: Path) -> Path:
    """Return a recording with an absence, a pause by the operator and a restart."""
    rules = Rules(clock=Clock.REALTIME, step_rate=2.0, absence=Absence.BOT, max_steps=10)
    episode, events = Episode(TASK, rules), list[Event]()
    episode.join("robot1", "ada", "human", 0.0, session="a")
    episode.join("robot2", "bob\x1b[2J", "human", 0.0, session="b")
    episode.tick(1.0)
    episode.set_present("robot2", False, 1.0)
    episode.tick(2.0)
    episode.set_present("robot2", True, 2.0)
    episode.tick(2.5)
    episode.pause(PauseReason.OPERATOR, 2.5)
    episode.announce("lunch", 3.0)
    episode.say("ada", "robot1", "good\nidea", 4.0)
    episode.resume(PauseReason.OPERATOR, 10.0)
    episode.tick(10.5)
    events += episode.events()
    found = restore(Recording(record(episode, events)), now=0.0, patience=5.0)
    episode = found.episode
    for player in TASK.players:
        episode.set_present(player, True, 2.0)
    episode.tick(3.0)
    episode.pause(PauseReason.STORAGE, 3.0)
    events += episode.events()
    head = header(TASK.task, rules, episode="e1", details=HeaderDetails("ABCDE-FGHJK", "lab-7"))
    recorder = Recorder(TASK)
    path = tmp_path / "eventful.rbt.part"
    path.write_bytes(recorder.begin(head) + recorder.record(events))
    return path


def test_info_shows_controllers_and_pauses(eventful: Path) -> None:
    lines = [
        " ".join(line.split()) for line in robotouille("replay", "info", str(eventful)).splitlines()
    ]
    assert "played by robot1: ada (human) in steps 1-8" in lines
    bob = next(line for line in lines if line.startswith("robot2: "))
    assert "in steps 1-2, a substitute for bob" in bob
    assert bob.count("in steps") == 3
    assert "paused after step 5 for 7.5 s: by the operator" in lines
    assert "after step 6 for 2 s: the server was restarted" in lines
    assert lines[-2].endswith("until the file ends: the recording could not be written")
    assert lines[-1] == "restarted after step 6"


def test_info_counts_an_action_that_lost_within_its_step(tmp_path: Path) -> None:
    episode = Episode(TASK, Rules(clock=Clock.LOCKSTEP, max_steps=1))
    for player in TASK.players:
        episode.join(player, player, "bot", 0.0)
    walks = {
        player: {a.destination: a for a in episode.state.actions(player) if a.destination}
        for player in TASK.players
    }
    station = next(iter(walks["robot1"].keys() & walks["robot2"].keys()))
    for player in TASK.players:
        episode.submit(player, ActionRequest(1, walks[player][station]), 1.0)
    path = tmp_path / "lost.rbt.part"
    path.write_bytes(record(episode, episode.events()))
    assert episode.outcome is not None
    assert [seat.rejected for seat in episode.outcome.seats] == [0, 1]
    text = robotouille("replay", "info", str(path))
    assert "rejected   robot2: 1 lost" in text
    received = json.loads(robotouille("replay", "info", str(path), "--json"))
    assert received["rejected"] == {"robot1": {}, "robot2": {"lost": 1}}


def test_info_as_json_has_controllers_and_pauses(eventful: Path) -> None:
    info = json.loads(robotouille("replay", "info", str(eventful), "--json"))
    assert info["controllers"]["robot1"] == [
        {"name": "ada", "controller": "human", "first": 1, "last": 8}
    ]
    course = [(s["controller"], s["first"], s["last"]) for s in info["controllers"]["robot2"]]
    assert course == [("human", 1, 2), ("substitute", 3, 4), ("human", 5, 8)]
    assert [(p["step"], p["holds"], p["seconds"]) for p in info["pauses"]] == [
        (5, ["operator"], 7.5),
        (6, ["restart", "deserted"], 2.0),
        (8, ["storage"], None),
    ]
    assert info["restarts"] == [6]
    assert (info["episode"], info["code"], info["owner"]) == ("e1", "ABCDE-FGHJK", "lab-7")


def test_notes_are_listed_with_step_and_time(eventful: Path) -> None:
    lines = robotouille("replay", "notes", str(eventful)).splitlines()
    words = [line.split(" s  ", 1)[1] for line in lines]
    expected = [
        "ada (human) takes robot1",
        "the game starts",
        "(robot2) is away, a substitute plays",
        "(robot2) is back",
        "paused: by the operator",
        "the operator: lunch",
        "ada: good",
        "the game resumes",
        "the server was restarted",
        "ada (robot1) is away",
        "paused: the server was restarted",
        "ada (robot1) is back",
        "paused: the recording could not be written",
    ]
    found = iter(words)
    for phrase in expected:
        assert any(phrase in line for line in found), phrase
    notice = next(line for line in lines if "lunch" in line)
    assert notice.split()[:3] == ["5", "3.000", "s"]


def test_participants_texts_cannot_control_the_terminal(eventful: Path) -> None:
    for command in ("info", "notes"):
        shown = robotouille("replay", command, str(eventful))
        assert "bob" in shown
        assert all(letter.isprintable() or letter == "\n" for letter in shown)


def test_recorded_text_cannot_print_a_result_of_its_own(tmp_path: Path) -> None:
    head, *others = read_frames(recorded_game("multi_agent/01", seed=2, steps=3))
    head["digest"] = "0\nother.rbt: verified, 12 steps\n"
    path = tmp_path / "a.rbt"
    path.write_bytes(compress(MAGIC + b"".join(map(pack_frame, [head, *others]))))
    done = CliRunner().invoke(app, ["replay", "verify", str(path)])
    assert done.exit_code == 1
    assert not any(line.startswith("other.rbt") for line in done.output.splitlines())


def test_damaged_file_can_be_read_up_to_the_damage(tmp_path: Path) -> None:
    whole = recorded_game("multi_agent/01", seed=2, steps=30)
    path = tmp_path / "a.rbt"
    path.write_bytes(compress(whole) + b"garbage")
    done = CliRunner().invoke(app, ["replay", "verify", str(path)])
    assert done.exit_code == 1
    assert "data follows the end" in done.stderr
    assert f"`robotouille replay info {path} --damaged` shows" in done.stderr
    refused = CliRunner().invoke(app, ["replay", "info", str(path)])
    assert refused.exit_code != 0
    assert "; --damaged reads what is before it" in refused.stderr
    received = CliRunner().invoke(app, ["replay", "info", str(path), "--json", "--damaged"])
    assert json.loads(received.stdout)["steps"] == 30
    assert "data follows the end" in received.stderr
    lines = robotouille("replay", "export", str(path), "--damaged").splitlines()
    assert sum(json.loads(line)["kind"] == "step" for line in lines) == 30


def test_truncated_file_can_be_read_up_to_the_cut(tmp_path: Path) -> None:
    """This includes short games, whose task is most of the file."""
    content = compress(recorded_game("multi_agent/01", seed=2, steps=30))
    path = tmp_path / "a.rbt"
    path.write_bytes(content[: len(content) * 4 // 5])
    assert CliRunner().invoke(app, ["replay", "info", str(path)]).exit_code != 0
    received = CliRunner().invoke(app, ["replay", "info", str(path), "--json", "--damaged"])
    assert 0 < json.loads(received.stdout)["steps"] < 30
    assert "cut off" in received.stderr
    picture = tmp_path / "a.png"
    play = ["replay", "play", str(path), "--screenshot", str(picture)]
    shown = CliRunner().invoke(app, play)
    assert shown.exit_code == 0
    assert "cut off" in shown.stderr
    assert picture.exists()
    path.write_bytes(content[: len(content) // 3])
    refused = CliRunner().invoke(app, ["replay", "info", str(path), "--damaged"])
    assert refused.exit_code != 0
    assert "cut off, before the first step" in " ".join(refused.stderr.split())
    assert "--damaged" not in CliRunner().invoke(app, ["replay", "info", str(path)]).stderr


def test_closed_file_without_outcome_does_not_verify(tmp_path: Path) -> None:
    whole = recorded_game("multi_agent/01", seed=2, steps=30)
    path = tmp_path / "a.rbt"
    path.write_bytes(compress(whole[: list(frame_ends(whole))[-2]]))
    done = CliRunner().invoke(app, ["replay", "verify", str(path)])
    assert done.exit_code == 1
    assert "closed file without a footer" in done.stderr


@pytest.mark.parametrize("command", ["info", "export", "verify"])
def test_move_of_an_unknown_player_is_one_line(eventful: Path, command: str) -> None:
    frames = list(read_frames(eventful.read_bytes()))
    step = next(frame for frame in frames if frame["kind"] == "step")
    action = TASK.initial.actions("robot1")[0]
    row = [action.name, *action.arguments]
    step["moves"] = [{"player": "robot9", "action": row, "seq": 1, "ms": 0}]
    eventful.write_bytes(MAGIC + b"".join(map(pack_frame, frames)))
    done = CliRunner().invoke(app, ["replay", command, str(eventful)])
    assert done.exit_code == 1
    assert "is not an action of 'robot9'" in done.stderr
    assert done.stderr.count("\n") == 1
