"""Codes that were closed before anybody came: so that who comes late is told why."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.runtime.workers import plain_code

__all__ = ["UnusedCode", "UnusedCodes"]

MAX_CODES = 10_000


@dataclass(frozen=True, slots=True)
class UnusedCode:
    """A code that nobody has used, as its episode was listed at last."""

    info: messages.EpisodeInfo
    owner: str


class UnusedCodes:
    """The last of a process's codes that were closed unused; the oldest are forgotten."""

    def __init__(self) -> None:
        self._codes: OrderedDict[str, UnusedCode] = OrderedDict()

    def __iter__(self) -> Iterator[UnusedCode]:
        return iter(self._codes.values())

    def add(self, unused: UnusedCode) -> None:
        """One more."""
        while len(self._codes) >= MAX_CODES:
            self._codes.popitem(last=False)
        self._codes[plain_code(unused.info.code)] = unused

    def check(self, name: str) -> None:
        """ProtocolError `episode/over` if this is one of them."""
        unused = self._codes.get(plain_code(name))
        if unused is not None:
            why = unused.info.detail or "it was closed"
            message = f"the episode {unused.info.code} is over before it began: {why}"
            raise ProtocolError("episode/over", message, "episode")
