"""The documentation lists exactly the error codes of the protocol."""

from __future__ import annotations

from robotouille.protocol.error_codes import ErrorCode
from tests.support.fuzzing.codes import documented_codes


def test_documented_codes_are_the_codes_of_the_protocol() -> None:
    assert {code.value for code in ErrorCode} == documented_codes()
