"""Hostile checkouts: no file outside is read, and no file takes long."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille.errors import FileError
from robotouille_evaluation.packs.pack import ExampleStep
from robotouille_evaluation.packs.published_checkout import read_checkout
from robotouille_evaluation.packs.published_configuration import parse_episode
from tests.support.checkouts import EXPERIMENT, PROBLEM, write_checkout

pytest.importorskip("yaml")

PLAIN = "conf/experiments/ReAct/plain.yaml"


def faults(folder: Path, files: dict[str, str | None]) -> str:
    return "\n".join(read_checkout(write_checkout(folder, files), seeds=[]).faults)


@pytest.mark.parametrize("base", ["../../../secret", "{}/secret", "../../../secret\0"])
def test_base_file_outside_is_not_read(tmp_path: Path, base: str) -> None:
    (tmp_path / "secret.yaml").write_text("api_key: hunter2\n")
    text = EXPERIMENT.replace("/llm: base_llm", f'/llm: "{base.format(tmp_path)}"')
    found = read_checkout(write_checkout(tmp_path / "checkout", {PLAIN: text}), seeds=[])
    assert found.pack.experiments == ()
    assert "hunter2" not in repr(found)
    (fault,) = found.faults
    assert "leads outside" in fault or "not YAML" in fault


@pytest.mark.parametrize(
    "path",
    [
        PLAIN,
        "conf/llm/base_llm.yaml",
        "agents/prompt_builder/prompts/ReAct/1.0.0-plain.yml",
        "agents/in_context_examples/data/synchronous/examples/0_toast_26.txt",
    ],
)
def test_links_outside_are_not_followed(tmp_path: Path, path: str) -> None:
    root = write_checkout(tmp_path / "checkout")
    outside = (root / path).rename(tmp_path / "outside")
    (root / path).symlink_to(outside)
    assert "leads outside" in "\n".join(read_checkout(root, seeds=[]).faults)


def test_domain_link_outside_is_an_error(tmp_path: Path) -> None:
    root = write_checkout(tmp_path / "checkout")
    outside = (root / "domain/robotouille.json").rename(tmp_path / "outside")
    (root / "domain/robotouille.json").symlink_to(outside)
    with pytest.raises(FileError, match="leads outside"):
        read_checkout(root)


def test_folder_outside_is_not_walked(tmp_path: Path) -> None:
    root = write_checkout(tmp_path / "checkout")
    outside = (root / "agents/prompt_builder/prompts").rename(tmp_path / "outside")
    (root / "agents/prompt_builder/prompts").symlink_to(outside)
    with pytest.raises(FileError, match="prompts: leads outside"):
        read_checkout(root, seeds=[])


def test_errors_do_not_quote_files(tmp_path: Path) -> None:
    found = faults(tmp_path, {PLAIN: "a: 1\nhunter2: [b: c: d\n"})
    assert "line 2: is not YAML" in found
    assert "hunter2" not in found


def chain(times: int, length: int) -> str:
    links = (f'  a{n}: "{f"${{llm.a{n + 1}}}" * times}"' for n in range(length))
    return "\n".join([EXPERIMENT, *links, f"  a{length}: ha\n"])


def escaped(levels: int) -> str:
    """Return settings in which each level doubles the backslashes of the last one."""
    links = [f"  a{n}: ['y${{llm.a{n - 1}}}']" for n in range(1, levels)]
    first = "  a0: ['" + 1000 * "\\" + "']"
    return "\n".join([EXPERIMENT, first, *links, f"  end: 'y${{llm.a{levels - 1}}}'\n"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: &a [1]\nb: *a\n", "line 2: aliases (*name) are not supported"),
        ("a: &a [*a]\n", "line 1: aliases (*name) are not supported"),
        (f"a: {'[' * 60}{']' * 60}\n", "nested more than 50 levels"),
        (f"a: {'[' * 5000}\n", "nested more than 50 levels"),
        (f"a: 0x{'f' * 9000}\n", ""),
        (f"b: 1\na: {':'.join('1' * 100_000)}\n", "line 2: a number has more than 100 char"),
        ("".join(f"{n}: 1\n" for n in range(100_000)), "more than 10,000 values"),
        (f"a: [{'1,' * 400_000}]\n", "more than 10,000 values"),
        (EXPERIMENT + f"  huge: 0x{'f' * 9000}\n", "more than 64 bits"),
        (EXPERIMENT + f"  0x{'f' * 900}: 1\n", "more than 64 bits"),
        pytest.param(chain(10, 15), "longer than 1,000,000 characters", marks=pytest.mark.slow),
        (escaped(14), "longer than 1,000,000 characters"),
        (EXPERIMENT + "  a:\n    b: ${llm.a}\n", "refers to itself"),
        (EXPERIMENT.replace("[5, 9]", "[" + "'x', " * 999 + "]"), "…"),
    ],
)
def test_growing_settings_are_refused(tmp_path: Path, text: str, words: str) -> None:
    found = faults(tmp_path, {PLAIN: text})
    assert words in found
    assert len(found) < 1000


def test_texts_that_utf_8_cannot_encode_are_refused(tmp_path: Path) -> None:
    prompts = "agents/prompt_builder/prompts"
    text = 'system: "\\ud800"\ninstructions: x\n'
    assert "line 1: a text has a lone surrogate" in faults(tmp_path, {f"{prompts}/x.yml": text})
    name = f"{prompts}/\udcff.yml"
    assert "the name is not UTF-8 text" in faults(tmp_path, {name: "system: x\ninstructions: x\n"})


def test_number_of_files_is_limited(tmp_path: Path) -> None:
    root = write_checkout(tmp_path)
    folder = root / "environments/env_generator/examples/synchronous"
    for number in range(501):
        (folder / f"{number}_copy.json").touch()
    with pytest.raises(FileError, match=r"synchronous: has more than 500 files \*\.json"):
        read_checkout(root)


@pytest.mark.slow
def test_instances_are_bounded_together(tmp_path: Path) -> None:
    folder = "environments/env_generator/examples/synchronous"
    large = json.dumps({**PROBLEM, "flooring": "x" * 4_000_000})
    files: dict[str, str | None] = {f"{folder}/{name}.json": large for name in ("0_a", "1_b")}
    with pytest.raises(FileError, match="the pack is larger than 100,663,296 bytes"):
        read_checkout(write_checkout(tmp_path, files))


@pytest.mark.slow
def test_examples_are_bounded_together(tmp_path: Path) -> None:
    text = f"Interaction 1\n---\nObservation: {'x' * 4_000_000}\nAction: y"
    folder = "agents/in_context_examples/data/synchronous/examples"
    files: dict[str, str | None] = {f"{folder}/{number}.txt": text for number in range(26)}
    with pytest.raises(FileError, match="the pack is larger than 100,663,296 bytes"):
        read_checkout(write_checkout(tmp_path, files), seeds=[])


PUBLISHED = (
    re.compile(r"Observation:\s*(?P<user>.*?)\n(?P<assistant>^Reasoning:.*)", re.M | re.S),
    re.compile(r"Observation:\s*(?P<user>.*?)(?P<assistant>^(?:Plan|Action):.*)", re.M | re.S),
)
PIECES = ["Observation:", "Reasoning:", "Plan:", "Action:", "\n", " ", "x", "\N{NO-BREAK SPACE}"]


@given(st.lists(st.sampled_from(PIECES), max_size=14).map("".join))
def test_examples_are_split_as_published(part: str) -> None:
    match = PUBLISHED[0].search(part) or PUBLISHED[1].search(part)
    text = f"Interaction 1\n---\n{part}"
    if match is None:
        with pytest.raises(FileError):
            parse_episode(text, "x")
    else:
        wanted = ExampleStep(match["user"], match["assistant"].rstrip())
        assert parse_episode(text, "x").steps == (wanted,)


def test_example_without_answers_is_quick() -> None:
    with pytest.raises(FileError, match="no observation with an answer"):
        parse_episode("Interaction 1\n---\n" + "Observation:\n" * 50_000, "x")
