"""Examples of the page on evaluating models."""

from __future__ import annotations

from typing import Any

import pytest

from robotouille_evaluation.models import ModelErrorKind, ModelRequest
from tests.support.openai_server import answer, endpoint, error
from tests.support.pages import blocks, read

PAGE = "evaluate_models.md"


@pytest.fixture
def names() -> dict[str, Any]:
    names: dict[str, Any] = {}
    for block in blocks(PAGE, "python"):
        exec(compile(block, PAGE, "exec"), names)
    return names


async def test_the_endpoint_example(names: dict[str, Any]) -> None:
    pytest.importorskip("openai")
    async with endpoint(answer("A fryer."), error(400)) as server:
        assert await names["ask"](server.url, "k") == "A fryer. (0.000064, 1 attempts)"
        assert await names["ask"](server.url, "k") == "refused, after 1 attempts"
    assert server.received[0].body["temperature"] == 0.7


async def test_the_scripted_example(names: dict[str, Any]) -> None:
    assert (await names["model"].complete(ModelRequest(()))).text.startswith("Reflection")


@pytest.mark.parametrize("kind", ModelErrorKind)
def test_every_error_kind_is_documented(kind: ModelErrorKind) -> None:
    assert f"| `{kind}` |" in read(PAGE)
