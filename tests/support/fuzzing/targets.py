"""All readers of untrusted input, as functions of bytes.

Each function returns "read", or the name of the project's error that refused the bytes. Any other
exception is a bug and propagates.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

from robotouille import World, load_task
from robotouille.certification.certificate import Certificate, check, json_text, read_certificate
from robotouille.domain.json_files import read_model
from robotouille.domain.rendering import RenderingFile
from robotouille.domain.schema import DomainFile, InputFile, ProblemFile
from robotouille.domain.task import Task, build_task
from robotouille.errors import FileError, ProtocolError, RecordingError, RobotouilleError
from robotouille.planning.plan import read_plan, replay
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MSGPACK, Codec
from robotouille.protocol.states import StateReader
from robotouille.replay.annotations import agreement, read_annotations, read_codebook
from robotouille.replay.annotations import rows as agreement_rows
from robotouille.replay.container import pack_frame
from robotouille.replay.controllers import json_lines
from robotouille.replay.recording import read_recording
from robotouille.world.lint import lint_task
from robotouille_data.exports.documents import rewrite_card
from robotouille_evaluation.metrics.rows import read_rows
from robotouille_evaluation.metrics.statistics import read_labels
from robotouille_evaluation.report.tables import all_tables, csv_text
from robotouille_evaluation.runs import RunFolder
from tests.support.fuzzing.codes import documented_codes

__all__ = ["Target", "file_targets", "message_targets"]

Target = Callable[[bytes], str]

READ = "read"
CONTROLS = {chr(point) for point in (*range(32), *range(127, 160))}


# Messages


def message_targets() -> dict[str, Target]:
    """Return the decoders of both subprotocols for the server and for the client."""
    return {
        "client-json": lambda data: _client_message(JSON, _text(data)),
        "client-msgpack": lambda data: _client_message(MSGPACK, data),
        "server-json": lambda data: _server_message(JSON, _text(data)),
        "server-msgpack": lambda data: _server_message(MSGPACK, data),
    }


def _text(data: bytes) -> str:
    """Return text like that of a text frame: UTF-8 without lone surrogates."""
    return data.decode(errors="replace")


def _client_message(codec: Codec, payload: bytes | str) -> str:
    """Decode like the server, and encode what it would reply, forward and record."""
    try:
        message = codec.decode_client(payload)
    except ProtocolError as error:
        return _answered(codec, error)
    _check_texts(message)
    for other in (JSON, MSGPACK):
        _on_the_wire(other, message)
    pack_frame(message.model_dump(mode="json"))
    return READ


def _check_texts(message: messages.ClientMessage) -> None:
    """Check that no text for others or for the recording contains a control character."""
    match message:
        case messages.Say(text=text):
            assert not CONTROLS.intersection(text)
        case messages.Note(text=text) | messages.Act(reasoning=str(text)):
            assert not (CONTROLS - {"\n", "\t"}).intersection(text)


def _answered(codec: Codec, error: ProtocolError) -> str:
    assert error.code in documented_codes(), f"undocumented code: {error.code}"
    assert error.message, f"{error.code} has no message"
    answer = messages.Error(
        ref=error.ref, code=error.code, message=error.message, field=error.field
    )
    size = _on_the_wire(codec, answer)
    assert size < 16 * 1024, f"error message of {size} bytes"
    return error.code


def _on_the_wire(codec: Codec, message: messages.Message) -> int:
    payload = codec.encode(message)
    return len(payload.encode() if isinstance(payload, str) else payload)


def _server_message(codec: Codec, payload: bytes | str) -> str:
    """Decode like a client, and read the state of a snapshot."""
    try:
        message = codec.decode_server(payload)
        if isinstance(message, messages.Snapshot) and message.task is not None:
            plain = message.model_dump()
            StateReader(World(Task.from_json(message.task)), plain, plain)
    except ProtocolError as error:
        assert error.code in documented_codes(), f"undocumented code: {error.code}"
        return error.code
    except FileError as error:
        return _refused(error)
    return READ


# Files


def file_targets(folder: Path) -> dict[str, Target]:
    """Return the readers of recordings and files; `folder` holds the file to read."""
    return {
        "recording": lambda data: _recording(_file(folder, "any.rbt", data)),
        "domain": lambda data: _domain(_file(folder, "any.domain.json", data)),
        "problem": lambda data: _problem(_file(folder, "any.json", data)),
        "input": lambda data: _model(_file(folder, "any.input.json", data), InputFile),
        "rendering": lambda data: _model(_file(folder, "any.rendering.json", data), RenderingFile),
        "plan": lambda data: _plan(data.decode(errors="replace")),
        "certificate": lambda data: _certificate(_file(folder, "any.certificate.json", data)),
        "rows": lambda data: _read(_tables, _file(folder, "rows.jsonl", data)),
        "run": lambda data: _read(_run, _file(folder, "run.json", data)),
        "labels": lambda data: _read(read_labels, _file(folder, "labels.json", data)),
        "codebook": lambda data: _read(read_codebook, _file(folder, "codes.json", data)),
        "annotations": lambda data: _read(_agreement, _file(folder, "meg.json", data)),
        "export": lambda data: _read(_card, _file(folder, "export.json", data)),
    }


def _file(folder: Path, name: str, data: bytes) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def _refused(error: RobotouilleError) -> str:
    """Check that an error has a message that fits on a screen, and return its name."""
    assert str(error).strip(), f"{type(error).__name__} has no message"
    if isinstance(error, FileError):
        assert error.faults, "FileError without faults"
    return type(error).__name__


def _read(use: Callable[[Path], object], path: Path) -> str:
    try:
        use(path)
    except RobotouilleError as error:
        return _refused(error)
    return READ


def _tables(path: Path) -> None:
    """Make the tables of a report, with the rows twice, so that sums overflow."""
    rows = read_rows(path)
    for table in all_tables([*rows, *rows]):
        csv_text(table).encode()


def _run(path: Path) -> None:
    for job in RunFolder(path.parent).plan().jobs:
        assert job.id.isalnum()


def _agreement(path: Path) -> None:
    found = read_annotations(path)
    other = found.model_copy(update={"coder": f"not {found.coder}"})
    assert list(agreement_rows(agreement([found, other])))


def _card(path: Path) -> None:
    (path.parent / "codebook.json").write_text('{"entries": []}', encoding="utf-8")
    rewrite_card(path.parent, {})


def _recording(path: Path) -> str:
    """Use every part of a recording."""
    try:
        recording = read_recording(path)
    except RecordingError as error:
        return _refused(error)
    recording.verify()
    try:
        list(recording.notes())
        list(recording.recorded_facts())
        for line in json_lines(recording, texts=len(recording.steps) < 5):
            json.loads(line)
    except RobotouilleError as error:
        return _refused(error)
    return READ


def _domain(path: Path) -> str:
    from tests.support.fuzzing.specimens import files

    kind = "workshop/02_two_workers.json" if b'"workshop"' in path.read_bytes() else ""
    problem = json.loads(files("problem")[2 if kind else 0])
    try:
        domain = read_model(path, DomainFile)
        return _played(build_task("any", domain, ProblemFile.model_validate(problem)))
    except FileError as error:
        return _refused(error)


def _problem(path: Path) -> str:
    try:
        return _played(load_task(str(path)))
    except FileError as error:
        return _refused(error)


def _played(task: Task) -> str:
    world = World(task)
    state = world.initial
    for turn in range(3):
        actions = [action for player in world.players for action in state.actions(player)]
        if actions:
            state = state.step(actions[turn % len(actions)]).state
    assert state.text()
    lint_task(task)
    assert Task.from_json(task.to_json()).digest == task.digest
    return READ


def _model(path: Path, model: type[InputFile] | type[RenderingFile]) -> str:
    try:
        read = read_model(path, model)
    except FileError as error:
        return _refused(error)
    if isinstance(read, RenderingFile):
        assert all(isinstance(name, str) for name in read.files())
    return READ


def _plan(text: str) -> str:
    world = _kitchen()
    try:
        report = replay(read_plan(text, world), world)
    except FileError as error:
        return _refused(error)
    assert report.ok or str(report)
    return READ


@cache
def _kitchen() -> World:
    return World(load_task("synchronous/01"))


def _certificate(path: Path) -> str:
    try:
        certificate = read_certificate(path)
        faults = check(certificate, load_task("synchronous/01"))
        assert all(faults)
        assert Certificate.model_validate_json(json_text(certificate)) == certificate
    except FileError as error:
        return _refused(error)
    return READ
