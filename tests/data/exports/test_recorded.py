"""Formats that are made from recordings: conversations, arrays and Minari data sets."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("pyarrow", reason="needs the extra `data`")

import numpy as np
import sqlalchemy as sa
from sqlalchemy.engine import URL

from robotouille import Sight, World, load_task, seen_by
from robotouille.episode import ActionRequest, Episode, Rules, Stepped
from robotouille.planning.policies.planner_policy import PlannerOptions
from robotouille.planning.policies.shift_policy import ShiftPolicy
from robotouille.replay import Recording, read_recording
from robotouille.replay.compression import compress, plain
from robotouille.replay.container import frame_ends, frame_value, pack_frame
from robotouille.replay.recorder import Recorder, header
from robotouille.world.sight import Seen
from robotouille_data.database import CatalogueError, database_url, writing_engine
from robotouille_data.exports import recorded
from robotouille_data.exports.exporting import export, task_slugs
from robotouille_data.exports.request import ExportFormat, ExportRequest
from robotouille_data.indexing import index
from robotouille_data.recording_rows import content_digest, episode_id
from robotouille_data.schema import EPISODES, RECORDINGS
from tests.support.random_study import Write, manifest, write_random_study
from tests.support.samples import quick_sample
from tests.support.shifts import file_of


@pytest.fixture(scope="session")
def recordings(study: Path) -> dict[int, Recording]:
    """Return the recordings of the study by episode id."""
    return {
        episode_id(content_digest(path.read_bytes())): read_recording(path)
        for path in study.glob("*.rbt")
    }


def own_moves(recording: Recording, player: str) -> list[Any]:
    """Return the applied actions of a player's participant."""
    return [
        move
        for move in recording.transitions()
        if move.seat == player and move.valid and move.action is not None and move.seq > 0
    ]


# Chat


def conversations(folder: Path) -> Iterator[tuple[dict[str, int], list[dict[str, str]]]]:
    rows = (folder / "lines.jsonl").read_text().splitlines()
    lines = (folder / "chat.jsonl").read_text().splitlines()
    for number, (row, line) in enumerate(zip(rows, lines, strict=True)):
        received = json.loads(row)
        assert received["line"] == number
        yield received, json.loads(line)["messages"]


@pytest.mark.slow
def test_conversation_contains_observations_and_actions(
    write: Write, recordings: dict[int, Recording]
) -> None:
    folder = write("chat", system="You cook.")
    seen = set()
    for received, messages in conversations(folder):
        recording = recordings[received["episode_id"]]
        player = recording.world.players[received["seat"]]
        moves = own_moves(recording, player)
        seen.add((recording, player))
        assert messages[0] == {"role": "system", "content": "You cook."}
        assert [m["role"] for m in messages[1:]] == ["user", "assistant"] * len(moves)
        assert [m["content"] for m in messages[1::2]] == [m.state.text_view(player) for m in moves]
        assert [m["content"] for m in messages[2::2]] == [f"Action: {m.text}" for m in moves]
        assert (received["step"], received["decisions"]) == (moves[0].step, len(moves))
    expected = {(r, p) for r in recordings.values() for p in r.world.players if own_moves(r, p)}
    assert seen == expected
    rows = {each["entry"]: each["rows"] for each in manifest(folder)["data"]}
    assert rows == {"chat": len(expected), "lines": len(expected)}


@pytest.mark.slow
def test_one_conversation_per_decision(write: Write, recordings: dict[int, Recording]) -> None:
    folder = write("chat", per_decision=True)
    found = list(conversations(folder))
    total = sum(len(own_moves(r, p)) for r in recordings.values() for p in r.world.players)
    assert len(found) == total == manifest(folder)["data"][1]["sums"]["decisions"]
    assert all([m["role"] for m in messages] == ["user", "assistant"] for _, messages in found)


@pytest.mark.slow
def test_datasets_loads_chat(write: Write, hub: Any) -> None:
    folder = write("chat", split={"train": 0.5, "test": 0.5})
    parts = {name: hub.load_dataset(str(folder), name) for name in ("chat", "lines")}
    for each in manifest(folder)["data"]:
        found = parts[each["entry"]][each["part"]]
        assert len(found) == each["rows"]
        for column, total in each["sums"].items():
            assert sum(found[column]) == total
    assert parts["chat"]["train"][0]["messages"][0]["role"] == "user"


# Arrays


@pytest.mark.slow
def test_arrays_equal_the_recordings(write: Write, recordings: dict[int, Recording]) -> None:
    folder = write("arrays")
    received = manifest(folder)
    codebook = {
        each["name"]: each for each in json.loads((folder / "codebook.json").read_text())["entries"]
    }
    rows = 0
    for written in received["data"]:
        with np.load(folder / written["path"], allow_pickle=False) as file:
            arrays = dict(file)
        entry = codebook[written["entry"]]
        assert [field["name"] for field in entry["fields"]] == list(arrays)
        assert len({len(array) for array in arrays.values()}) == 1
        assert len(arrays["step"]) == written["rows"] == entry["rows"]
        for name, total in written["sums"].items():
            assert arrays[name].sum() == total
        assert arrays["observations"].shape[1] == len(entry["columns"])
        rows += written["rows"]
        for number in set(arrays["episode"].tolist()):
            check_episode(recordings[number], arrays, arrays["episode"] == number, entry)
    assert rows == received["steps"] * 2


def check_episode(recording: Recording, arrays: Any, chosen: Any, entry: Any) -> None:
    states = dict(recording.states())
    for seat, player in enumerate(recording.world.players):
        mine = chosen & (arrays["seat"] == seat)
        assert arrays["step"][mine].tolist() == list(range(1, len(states)))
        sentences = entry["actions"][player]
        vectors = np.stack([states[step - 1].vector() for step in arrays["step"][mine]])
        assert (arrays["observations"][mine] == vectors).all()
        for step, mask in zip(arrays["step"][mine], arrays["masks"][mine], strict=True):
            valid = {action.sentence for action in states[step - 1].actions(player)}
            assert {sentences[number] for number in np.flatnonzero(mask)} == valid
        own = mine & arrays["own"]
        did = [
            (step, sentences[number])
            for step, number in zip(arrays["step"][own], arrays["actions"][own], strict=True)
        ]
        assert did == [(move.step, move.text) for move in own_moves(recording, player)]
        assert arrays["rewards"][mine].sum() == states[len(states) - 1].goal_reached


def test_exports_contain_what_players_saw(tmp_path: Path) -> None:
    world, folder = World("multi_agent/07@2"), tmp_path / "recordings"
    rules, (one, other) = Rules(max_steps=4, sight=1, sight_blocked=True), world.players
    episode, recorder = Episode(world, rules), Recorder(world)
    stream = recorder.begin(header(world.task, rules, episode="e", seed=0, created="2026"))
    episode.join(one, "ada", "human", 0.0)
    episode.join(other, "ben", "human", 0.0)
    while not episode.ended:
        number = episode.step + 1
        for player in world.players:
            action = next(a for a in episode.state.actions(player) if a.destination)
            episode.submit(player, ActionRequest(number, action), float(number))
        stream += recorder.record(episode.events())
    folder.mkdir()
    (folder / "sight.rbt").write_bytes(compress(stream))
    index(database_url(None, folder), [folder])
    formats = ExportFormat("chat"), ExportFormat("arrays")
    export(database_url(None, folder), tmp_path / "out", ExportRequest(formats))
    recording = read_recording(folder / "sight.rbt")
    states = dict(recording.states())

    def seen(step: int, player: str) -> Seen:
        return seen_by(states[step - 1], player, Sight(1, blocked=True))

    for received, messages in conversations(tmp_path / "out"):
        player = world.players[received["seat"]]
        texts = [m["content"] for m in messages[::2]]
        moves = own_moves(recording, player)
        assert texts == [seen(move.step, player).text_view(player) for move in moves]
    (path,) = (tmp_path / "out").glob("**/*.npz")
    with np.load(path, allow_pickle=False) as file:
        arrays = dict(file)
    for row, step in enumerate(arrays["step"]):
        known = seen(int(step), world.players[arrays["seat"][row]])
        assert (arrays["observations"][row] == known.state.vector()).all()
        assert arrays["masks"][row].sum() == len(known.actions)


@pytest.fixture
def shift(tmp_path: Path) -> tuple[Path, Recording]:
    """Return the folder of a recorded shift in which a bot serves, and the recording."""
    path, folder = tmp_path / "shift.json", tmp_path / "recordings"
    path.write_text(json.dumps(file_of(steps=60)))
    folder.mkdir()
    world, rules = World(f"{path}@1"), Rules(max_steps=1000)
    episode, recorder = Episode(world, rules), Recorder(world)
    stream = recorder.begin(header(world.task, rules, episode="e", seed=0, created="2026"))
    (me,) = world.players
    policy = ShiftPolicy(world, me, PlannerOptions(alone=True))
    episode.join(me, "ada", "human", 0.0)
    while not episode.ended:
        number = episode.step + 1
        action = policy.act(episode.state)
        episode.submit(me, ActionRequest(number, action), float(number))
        for event in (events := list(episode.events())):
            if isinstance(event, Stepped):
                policy.observe(
                    [
                        (me, m.action, a.applied)
                        for m, a in zip(event.moves, event.attempts, strict=True)
                    ]
                )
        stream += recorder.record(events)
    (folder / "shift.rbt").write_bytes(compress(stream))
    index(database_url(None, folder), [folder])
    return folder, read_recording(folder / "shift.rbt")


@pytest.mark.parametrize("format", ["arrays", "minari"])
def test_rewards_of_a_shift_are_its_points(
    shift: tuple[Path, Recording], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, format: str
) -> None:
    folder, recording = shift
    assert recording.outcome is not None
    points = recording.outcome["score"]["points"]
    assert points
    out = tmp_path / "out"
    export(database_url(None, folder), out, ExportRequest((ExportFormat(format),)))
    (written,) = manifest(out)["data"]
    assert written["sums"]["rewards"] == points
    if format == "arrays":
        with np.load(out / written["path"], allow_pickle=False) as file:
            ends = file["terminations"]
    else:
        minari = pytest.importorskip("minari", reason="needs the extra `minari`")
        monkeypatch.setenv("MINARI_DATASETS_PATH", str(out / written["part"]))
        (episode,) = minari.load_dataset(written["entry"]).iterate_episodes()
        ends = episode.terminations
        assert not episode.truncations.any()
    assert ends.tolist() == [False] * (len(ends) - 1) + [True]


# Minari


@pytest.mark.slow
@pytest.mark.parametrize("split", [{}, {"train": 0.5, "test": 0.5}])
def test_minari_loads_the_data_set_of_each_seat(
    write: Write, monkeypatch: pytest.MonkeyPatch, split: dict[str, float]
) -> None:
    minari = pytest.importorskip("minari", reason="needs the extra `minari`")
    folder, arrays = write("minari", split=split), write("arrays")
    received, tables = manifest(folder), manifest(arrays)
    steps = 0
    for written in received["data"]:
        monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder / written["part"]))
        dataset = minari.load_dataset(written["entry"])
        assert dataset.total_steps == written["rows"]
        episodes = list(dataset.iterate_episodes())
        assert sum(int(each.actions.sum()) for each in episodes) == written["sums"]["actions"]
        assert sum(each.rewards.sum() for each in episodes) == written["sums"]["rewards"]
        for each in episodes:
            seen, masks = each.observations["observation"], each.observations["action_mask"]
            assert dataset.observation_space["observation"].contains(seen[0])
            assert len(seen) == len(each.actions) + 1
            assert masks[np.arange(len(each.actions)), each.actions].all()
            assert len(each.infos["own"]) == len(seen)
            nothing = dataset.action_space.n - 1
            assert (each.actions[each.infos["own"][:-1].astype(bool)] < nothing).all()
            assert each.terminations[-1] != each.truncations[-1]
            assert not (each.terminations | each.truncations)[:-1].any()
        told_of = dataset.storage.get_episode_metadata(dataset.episode_indices)
        assert all(each["reason"] and each["episode"] for each in told_of)
        steps += written["rows"]
    assert steps == sum(each["rows"] for each in tables["data"])


def test_minari_folder_variable_is_restored(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("minari", reason="needs the extra `minari`")
    monkeypatch.setenv("MINARI_DATASETS_PATH", "/somewhere")
    folder = write("minari", query="SELECT id FROM episodes WHERE episode = 'random1'")
    import os

    assert os.environ["MINARI_DATASETS_PATH"] == "/somewhere"
    assert len(manifest(folder)["data"]) == 2


# Missing and changed recordings


@pytest.fixture
def own_study(tmp_path: Path) -> Path:
    folder = tmp_path / "recordings"
    write_random_study(folder)
    index(database_url(None, folder), [folder])
    return folder


@pytest.mark.slow
def test_missing_and_changed_recordings_are_faults(own_study: Path, tmp_path: Path) -> None:
    gone, changed, copied = (own_study / f"random{number}.rbt" for number in (1, 2, 4))
    ids = [episode_id(content_digest(path.read_bytes())) for path in (gone, changed)]
    shutil.copy(copied, own_study / "copy.rbt")
    index(database_url(None, own_study), [own_study])
    gone.unlink()
    copied.unlink()
    changed.write_bytes(changed.read_bytes()[:-3])
    found = export(
        database_url(None, own_study), tmp_path / "out", ExportRequest((ExportFormat.CHAT,))
    )
    assert [found.faults[number] for number in ids] == [
        "the recording is missing",
        "the recording was changed after it was indexed",
    ]
    assert len(found.faults) == 2
    assert manifest(tmp_path / "out")["faults"].keys() == set(map(str, ids))


def test_conversations_of_an_episode_are_limited(
    url: URL, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A recording of 70 KB took gigabytes of memory."""
    monkeypatch.setattr(recorded, "MAX_CHAT", 20_000)
    found = export(url, tmp_path / "out", ExportRequest((ExportFormat.CHAT,)))
    assert found.faults
    assert set(found.faults.values()) == {"more than 0 MiB of text"}
    whole = list(conversations(tmp_path / "out"))
    assert whole
    assert not {row["episode_id"] for row, _ in whole} & found.faults.keys()
    assert [row["line"] for row, _ in whole] == list(range(len(whole)))


def test_observations_of_an_episode_for_minari_are_limited(
    url: URL, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A recording of 10 KB took four gigabytes."""
    minari_sets = pytest.importorskip("robotouille_data.exports.minari_sets")
    monkeypatch.setattr(minari_sets, "MAX_BYTES", 30_000)
    found = export(url, tmp_path / "out", ExportRequest((ExportFormat.MINARI,)))
    assert found.faults
    assert all("MiB of observations; at most" in fault for fault in found.faults.values())


def test_file_names_of_tasks_are_distinct() -> None:
    """The name of a task could be the one that another task got with its digest."""
    engine = sa.create_engine("sqlite://")
    digests = {"1" * 64: "study", "2" * 64: "Study", "3" * 64: "study-11111111"}
    with engine.begin() as connection:
        connection.execute(sa.text("CREATE TABLE episodes (id INTEGER, digest TEXT, task TEXT)"))
        for number, (digest, task) in enumerate(digests.items()):
            row = {"id": number, "digest": digest, "task": task}
            connection.execute(sa.insert(EPISODES).values(row))
        some = task_slugs(connection, [0, 1])
        every = task_slugs(connection, [0, 1, 2])
    assert some == {"1" * 64: "study-11111111", "2" * 64: "Study-22222222"}
    assert len({slug.lower() for slug in every.values()}) == 3


@pytest.mark.slow
def test_recording_that_simulates_differently_is_a_fault(own_study: Path, tmp_path: Path) -> None:
    path = own_study / "random3.rbt"
    stream, _ = plain(path.read_bytes())
    pieces, begin = [stream[:5]], 5
    for end in frame_ends(stream):
        frame = frame_value(stream, begin, end)
        if frame["kind"] == "step" and frame["step"] == 10:
            frame["hash"] = "0" * 32
        pieces.append(pack_frame(frame))
        begin = end
    path.write_bytes(compress(b"".join(pieces)))
    index(database_url(None, own_study), [own_study])
    found = export(
        database_url(None, own_study), tmp_path / "out", ExportRequest((ExportFormat.ARRAYS,))
    )
    assert list(found.faults.values()) == [
        "step 10 has a different result with this version's rules"
    ]


@pytest.mark.parametrize("elsewhere", quick_sample(["pipe", "/dev/zero", "other"]))
def test_changed_path_in_the_catalogue_is_a_fault(
    own_study: Path, tmp_path: Path, elsewhere: str
) -> None:
    os.mkfifo(tmp_path / "pipe")
    shutil.copy(own_study / "random2.rbt", tmp_path / "other")
    url = database_url(None, own_study)
    index(url, [own_study])
    with writing_engine(url).begin() as connection:
        its = RECORDINGS.c.path
        where = its == str(own_study / "random1.rbt")
        connection.execute(
            sa.update(RECORDINGS).where(where).values(path=str(tmp_path / elsewhere))
        )
    found = export(url, tmp_path / "out", ExportRequest((ExportFormat.CHAT,)))
    (fault,) = found.faults.values()
    assert fault in (
        "the recording cannot be read: not a regular file",
        "the recording was changed after it was indexed",
    )


def test_export_without_any_recording_is_an_error(own_study: Path, tmp_path: Path) -> None:
    for path in own_study.glob("*.rbt"):
        path.unlink()
    with pytest.raises(CatalogueError, match="nothing to write: the recording is missing"):
        export(database_url(None, own_study), tmp_path / "out", ExportRequest((ExportFormat.CHAT,)))
    assert not (tmp_path / "out").exists()


# Reasoning, and several formats at once


@pytest.fixture
def thoughtful(tmp_path: Path) -> Path:
    """Return a folder with one recording, in which a model gives its reasoning."""
    folder = tmp_path / "thoughtful"
    folder.mkdir()
    world = World(load_task("synchronous/01"))
    rules = Rules(max_steps=2)
    episode, recorder = Episode(world, rules), Recorder(world)
    stream = recorder.begin(header(world.task, rules, episode="thoughtful"))
    episode.join("robot1", "small", "model", 0.0)
    for seq, why in ((1, "bread is there"), (2, "")):
        episode.submit(
            "robot1", ActionRequest(seq, episode.state.actions("robot1")[0], reasoning=why), seq
        )
    content = compress(stream + recorder.record(episode.events()))
    (folder / "thoughtful.rbt").write_bytes(content)
    index(database_url(None, folder), [folder])
    return folder


@pytest.mark.parametrize("texts", [True, False])
def test_reasoning_precedes_the_action(thoughtful: Path, tmp_path: Path, texts: bool) -> None:
    request = ExportRequest((ExportFormat.CHAT,), texts=texts)
    export(database_url(None, thoughtful), tmp_path / "out", request)
    [(_, messages)] = conversations(tmp_path / "out")
    said = [message["content"] for message in messages[1::2]]
    assert said[0].startswith("Reasoning: bread is there\nAction: " if texts else "Action: ")
    assert said[1].startswith("Action: ")


@pytest.mark.slow
def test_several_formats_share_a_folder(write: Write) -> None:
    folder = write("csv", "chat", "arrays", "parquet")
    received = manifest(folder)
    assert {each["format"] for each in received["data"]} == set(received["formats"])
    names = {path.suffix for path in folder.iterdir()}
    assert names == {".csv", ".parquet", ".jsonl", ".npz", ".json", ".md"}
    rows = {(each["entry"], each["format"]): each["rows"] for each in received["data"]}
    for entry in json.loads((folder / "codebook.json").read_text())["entries"]:
        assert {n for (name, _), n in rows.items() if name == entry["name"]} == {entry["rows"]}
    assert 'path: "steps.parquet"' in (folder / "README.md").read_text()
    assert "steps.csv" not in (folder / "README.md").read_text().partition("# ")[0]
