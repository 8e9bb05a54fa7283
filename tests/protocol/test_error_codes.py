"""The codes on the wire are those that the documentation lists."""

from __future__ import annotations

import re

import pytest

from robotouille.protocol.error_codes import ErrorCode
from tests.support.fuzzing.codes import documented_codes


def test_every_code_is_documented_and_every_documented_code_is_one() -> None:
    assert {code.value for code in ErrorCode} == documented_codes()


@pytest.mark.parametrize("code", ErrorCode)
def test_a_code_names_a_group_and_a_fault(code: ErrorCode) -> None:
    assert re.fullmatch(r"[a-z]+/[a-z-]+", code)
    assert code.name == code.upper().replace("/", "_").replace("-", "_")
