"""Coverage-guided fuzzing of the decoders of both subprotocols; see README.md."""

import sys

import atheris

with atheris.instrument_imports(include=["robotouille"]):
    from tests.support.fuzzing.specimens import MESSAGE_KINDS
    from tests.support.fuzzing.targets import message_targets

TARGETS = [message_targets()[name] for name in MESSAGE_KINDS]


def one_input(data: bytes) -> None:
    """The first byte chooses the decoder."""
    if data:
        TARGETS[data[0] % len(TARGETS)](data[1:])


if __name__ == "__main__":
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()
