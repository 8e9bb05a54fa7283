"""The coverage-guided fuzzers and their corpus, run without Atheris: every seed, once."""

from __future__ import annotations

import contextlib
import importlib
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest

from robotouille.replay.container import MAGIC, read_frames
from tests.programs import corpus
from tests.support.fuzzing.specimens import recordings
from tests.support.fuzzing.targets import Target

LIMIT = 100_000


def without_atheris() -> ModuleType:
    """What the fuzzers need of `atheris` until they are started."""
    stub = ModuleType("atheris")
    stub.instrument_imports = lambda include: contextlib.nullcontext()  # type: ignore[attr-defined]
    stub.Mutate = lambda data, size: (data + b"\xc1")[:size]  # type: ignore[attr-defined]
    return stub


@pytest.fixture
def fuzzer(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Iterator[Callable[[str], ModuleType]]:
    """Import a fuzzer by the name of its corpus."""
    monkeypatch.setitem(sys.modules, "atheris", without_atheris())
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    imported: list[str] = []

    def load(kind: str) -> ModuleType:
        imported.append(f"tests.programs.atheris_{kind}")
        return importlib.import_module(imported[-1])

    yield load
    for name in imported:
        sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The corpus, as it is written for the fuzzers."""
    path = tmp_path_factory.mktemp("corpus")
    corpus.main(path)
    return path


def seeds(folder: Path, kind: str) -> list[bytes]:
    found = [path.read_bytes() for path in sorted((folder / kind).iterdir())]
    assert len(found) >= 10
    return found


def listening(target: Target, outcomes: list[str]) -> Target:
    """A target that notes what became of what it was given."""

    def read(data: bytes) -> str:
        outcomes.append(target(data))
        return outcomes[-1]

    return read


@pytest.mark.parametrize("kind", ["messages", "files"])
def test_every_seed_reaches_the_reader_that_it_is_for(
    fuzzer: Callable[[str], ModuleType], folder: Path, kind: str
) -> None:
    module = fuzzer(kind)
    kinds = corpus.MESSAGE_KINDS if kind == "messages" else corpus.FILE_KINDS
    outcomes: dict[str, list[str]] = {name: [] for name in kinds}
    pairs = zip(module.TARGETS, kinds, strict=True)
    module.TARGETS[:] = [listening(target, outcomes[name]) for target, name in pairs]
    module.one_input(b"")
    for seed in seeds(folder, kind):
        module.one_input(seed)
    for name, of_kind in outcomes.items():
        # A plan of another task is refused by its header.
        assert of_kind.count("read") == len(of_kind) - (name == "plan"), (name, Counter(of_kind))
        assert of_kind


def test_every_recording_of_the_corpus_is_read_or_refused(
    fuzzer: Callable[[str], ModuleType], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = fuzzer("recordings")
    outcomes: list[str] = []
    monkeypatch.setattr(module, "read", listening(module.read, outcomes))
    for seed in seeds(folder, "recordings"):
        module.one_input(seed)
    assert set(outcomes) == {"read", "RecordingError"}
    assert outcomes.count("read") >= len(recordings())


def test_mutations_change_double_and_leave_out_frames(
    fuzzer: Callable[[str], ModuleType], folder: Path
) -> None:
    module = fuzzer("recordings")
    sizes = Counter[str]()
    plain = [seed for seed in seeds(folder, "recordings") if seed.startswith(MAGIC)]
    for number, seed in enumerate(plain * 5):
        mutated = module.mutate(seed, LIMIT, number)
        assert len(mutated) <= LIMIT
        module.one_input(mutated)
        before, after = len(module._payloads(seed)), len(module._payloads(mutated))
        sizes["more" if after > before else "fewer" if after < before else "as many"] += 1
    assert len(sizes) == 3, "frames are never doubled or left out"
    assert sizes["as many"] > sizes["more"] + sizes["fewer"]


def test_a_mutation_passes_the_checksums(fuzzer: Callable[[str], ModuleType]) -> None:
    whole = next(content for content in recordings() if content.startswith(MAGIC))
    module = fuzzer("recordings")
    mutated = next(
        found
        for found in (module.mutate(whole, LIMIT, number) for number in range(20))
        if len(module._payloads(found)) < len(module._payloads(whole))
    )
    assert len(list(read_frames(mutated))) == len(list(read_frames(whole))) - 1
