"""Small inputs that demand much are refused within bounded memory and processor time.

Each reader runs in a separate process under limits of the operating system, so that an input that
exceeds them ends that process and not the tests.
"""

from __future__ import annotations

import asyncio
import json
import os
import random
import resource
import subprocess
import sys
from collections import Counter
from pathlib import Path

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille.errors import ProtocolError
from robotouille.protocol.codec import JSON, MSGPACK
from robotouille.replay.compression import compress, unwrap
from robotouille.replay.container import MAGIC
from tests.support.fuzzing.adversary import Adversary
from tests.support.fuzzing.forgery import framed
from tests.support.fuzzing.hostile_inputs import HOSTILE_INPUTS
from tests.support.fuzzing.specimens import MESSAGE_KINDS, recordings
from tests.support.fuzzing.targets import message_targets
from tests.support.fuzzing.wire import CONTINUATION, TEXT, Closed, Wire, frame
from tests.support.servers import raw, serving
from tests.support.thorough import thorough
from tests.support.virtual_time import run

MEMORY = 3 * 1024**3
"""Address space in bytes; an uncompressed recording may have 256 MiB."""
CPU_SECONDS = 60

READ = """
import sys
from pathlib import Path
from tests.support.fuzzing.targets import file_targets, message_targets
folder, kind = Path(sys.argv[1]), sys.argv[2]
data = (folder / "data").read_bytes()
print((message_targets() | file_targets(folder))[kind](data))
"""


def _confine() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS))


def confined(folder: Path, kind: str, data: bytes) -> str:
    """Run a reader of `tests.support.fuzzing.targets` under limits and return its result."""
    (folder / "data").write_bytes(data)
    done = subprocess.run(
        [sys.executable, "-c", READ, str(folder), kind],
        capture_output=True,
        text=True,
        preexec_fn=_confine,
        cwd=Path(__file__).parents[2],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr[-1500:]
    return done.stdout.strip()


def zeros(gibibytes: int) -> bytes:
    """Return many GiB of compressed zeros: repeated Zstandard blocks of one byte each."""
    block = (1 << 17 << 3 | 1 << 1).to_bytes(3, "little") + b"\0"
    end = (1 << 1 | 1).to_bytes(3, "little") + b"\0"
    header = b"\x28\xb5\x2f\xfd" + b"\x00\x58"
    return header + block * (gibibytes * 8192) + end


def deep(levels: int, *, message: bool = False) -> bytes:
    inside = b"\x81\xa1a" * levels + b"\xc0"
    return inside if message else b"\x82\xa4kind\xa6footer\xa7outcome" + inside


def crowded_problem(items: int, arity: int) -> bytes:
    """Return a problem with many items in a kitchen with a predicate of this arity."""
    import copy
    import json

    from tests.support.broken_files import DOMAIN, PROBLEM

    domain, problem = copy.deepcopy(DOMAIN), copy.deepcopy(PROBLEM)
    domain["predicate_defs"].append({"name": "near", "param_types": ["item"] * arity})
    names = [f"x{i}" for i in range(arity)]
    made = {"predicate": "near", "params": names}
    domain["action_defs"][0]["immediate_fx"].append({**made, "params": ["i"] * arity})
    problem["width"] = problem["height"] = 40
    places = [{"name": "leek", "x": n % 40, "y": n // 40} for n in range(items)]
    problem["objects"]["item"] = [{**places[0], "id": "first"}, *places[1:]]
    return json.dumps({"domain": domain, "problem": problem}).encode()


WHOLE = unwrap(recordings()[0])
BOMBS = {
    "zstd of 4 GiB": ("recording", zeros(4)),
    "zstd that is cut off": ("recording", compress(WHOLE)[:-9]),
    "zstd inside zstd": ("recording", compress(compress(WHOLE))),
    "a frame of 4 GiB": ("recording", WHOLE + b"\xff\xff\xff\xff\0\0\0\0\xff\xff\xff\xff"),
    "a list of 4 billion": ("recording", WHOLE + framed(b"\x81\xa4kind\xdd\xff\xff\xff\xff")),
    "frames 500 deep": ("recording", WHOLE + framed(deep(500))),
    "frames 900 deep": ("recording", WHOLE + framed(deep(900))),
    "frames 100,000 deep": ("recording", WHOLE + framed(deep(100_000))),
    "500,000 empty frames": ("recording", MAGIC + framed(b"\x80") * 500_000),
    "messages 20,000 deep": ("client-msgpack", deep(20_000, message=True)),
    "server messages 900 deep": ("server-msgpack", deep(900, message=True)),
    "JSON 60,000 deep": ("client-json", b"[" * 60_000),
    "JSON 4,000,000 deep": ("problem", b'{"a":' * 800_000),
    "a number of 60,000 digits": ("client-json", b'{"type":"list","ref":' + b"9" * 60_000 + b"}"),
    "30,000 escapes": ("client-json", b'{"type":"say","text":"' + b"\\" * 60_000 + b'"}'),
    "6,000 names": (
        "client-json",
        b'{"type":"list",' + b",".join(b'"x%d":0' % i for i in range(6000)) + b"}",
    ),
    "10,000 unknown fields": (
        "problem",
        b"{" + b",".join(b'"width%d":0' % i for i in range(10_000)) + b"}",
    ),
    "10,000 strange steps": ("plan", b"mvoe(robot1, tabel1)\n" * 10_000),
    "a step of 20,000 actions": ("plan", b"; ".join([b"move(robot1, table1, table2)"] * 20_000)),
    "a file of 5 MiB": ("domain", b'"' + b"x" * (5 * 1024**2) + b'"'),
}


@pytest.mark.process
@pytest.mark.parametrize("name", BOMBS)
def test_demanding_input_is_refused(tmp_path: Path, name: str) -> None:
    kind, data = BOMBS[name]
    assert confined(tmp_path, kind, data) not in ("read", "")


@pytest.mark.process
@pytest.mark.parametrize(("items", "arity"), [(900, 2), (100, 3), (60, 4)])
def test_kitchen_with_too_many_possible_facts_is_refused(
    tmp_path: Path, items: int, arity: int
) -> None:
    """The check precedes any use of a task from a file, a recording or a snapshot."""
    (tmp_path / "task.json").write_bytes(crowded_problem(items, arity))
    code = (
        "import sys, json; from robotouille import FileError, World\n"
        "from robotouille.domain.task import Task\n"
        "try: World(Task.from_json(json.load(open(sys.argv[1]))))\n"
        "except FileError as error: print('refused', error)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "task.json")],
        capture_output=True,
        text=True,
        preexec_fn=_confine,
    )
    assert done.stdout.startswith("refused"), (done.returncode, done.stderr[-300:])


def test_number_of_empty_fragments_is_limited(tmp_path: Path) -> None:
    """Empty fragments have no size that could be limited, so their number is limited."""

    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as honest:
            wire = await Wire.open(server.port)
            await wire.upgrade(text=True)
            await wire.write(frame(b"", TEXT, fin=False))
            with pytest.raises(Closed) as closed:
                for _ in range(200):
                    await wire.write(frame(b"", CONTINUATION, fin=False) * 500)
                    await asyncio.sleep(0.01)
                async with asyncio.timeout(5):
                    async for _ in wire.messages():
                        pass
            wire.cut()
            assert closed.value.code in (None, 1008, 1009)
            assert (await honest.ask({"type": "list"}, "episodes"))["type"] == "episodes"

    run(main())


TARGETS = message_targets()
kinds = pytest.mark.parametrize("kind", MESSAGE_KINDS)


@kinds
@thorough(300)
@given(data=st.binary(max_size=300))
def test_any_bytes_are_decoded_or_refused(kind: str, data: bytes) -> None:
    TARGETS[kind](data)


@kinds
@thorough(500)
@given(chance=st.randoms())
def test_faulty_messages_are_decoded_or_refused(kind: str, chance: random.Random) -> None:
    TARGETS[kind](HOSTILE_INPUTS[kind](Adversary(chance)))


@kinds
def test_hostile_inputs_trigger_every_error(kind: str) -> None:
    adversary = Adversary(1)
    met = Counter(TARGETS[kind](HOSTILE_INPUTS[kind](adversary)) for _ in range(3000))
    wrong = ["unknown-type", "missing-field", "invalid-field", "malformed"]
    if kind.startswith("client"):  # Clients ignore unknown fields of newer servers.
        wrong.append("unknown-field")
    assert met.keys() >= {"read", *(f"message/{word}" for word in wrong)}, met


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ('{"type":"list","ref":true}', "ref"),
        ('{"type":"act","seq":true,"action":null}', "seq"),
        ('{"type":"act","seq":1.0,"action":null}', "seq"),
        ('{"type":"act","seq":1,"action":null,"basis":1e400}', "basis"),
        ('{"type":"act","seq":1,"action":' + "9" * 4000 + "}", "action"),
        ('{"type":"act","seq":1,"action":null,"basis":' + "9" * 4000 + "}", "basis"),
        ('{"type":"create","step_rate":1e400}', "step_rate"),
        ('{"type":"create","seed":-1}', "seed"),
    ],
)
def test_invalid_number_is_named_in_the_error(text: str, field: str) -> None:
    """Languages disagree on integers above 2^53, and booleans are not numbers."""
    plain = json.loads(text)
    for codec in (JSON, MSGPACK):
        try:
            payload = text if codec is JSON else msgpack.packb(plain)
        except OverflowError:
            continue
        with pytest.raises(ProtocolError) as refused:
            codec.decode_client(payload)
        assert refused.value.code == "message/invalid-field"
        assert refused.value.field.startswith(field)
        assert refused.value.ref is None
