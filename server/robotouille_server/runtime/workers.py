"""One of several processes that share a port, each with episodes of its own.

An episode's id and code say which process has it, so that every process can send a client there.
"""

from __future__ import annotations

from dataclasses import dataclass

from robotouille.protocol import messages

__all__ = ["CODE_LETTERS", "ElsewhereError", "WorkerSlot", "plain_code"]


def plain_code(code: str) -> str:
    """A join code without what people may leave out or add: dashes, spaces, case."""
    return "".join(code.split()).replace("-", "").upper()


CODE_LETTERS = "ABCDEFGHJKMNPQRSTUVWXYZ"
"""Those that are not taken for one another; as many workers there can be."""


class ElsewhereError(Exception):
    """An episode is with another worker."""

    def __init__(self, episode: str, port: int, url: str) -> None:
        self.episode = episode
        self.port = port
        self.url = url
        super().__init__(f"{episode} is served on port {port}")

    def moved(self, ref: int | None) -> messages.Moved:
        return messages.Moved(ref=ref, episode=self.episode, port=self.port, url=self.url)


@dataclass(frozen=True, slots=True)
class WorkerSlot:
    """The `index`th of `count` workers; `first_port` is the first one's own port, `url` a
    template of a worker's address with `{worker}` in it, or empty."""

    index: int = 0
    count: int = 1
    first_port: int = 0
    url: str = ""

    def mark_id(self, bits: int) -> str:
        """A 64-bit episode id whose first two digits are the worker's number."""
        name = f"{bits:016x}"
        return name if self.count == 1 else f"{self.index:02x}{name[2:]}"

    def mark_letter(self, letter: str) -> str:
        """The first letter of a code."""
        return letter if self.count == 1 else CODE_LETTERS[self.index]

    def file_name(self, name: str) -> str:
        """A name of a file that each worker has for itself: `audit.log`, or `audit.0.log`."""
        stem, dot, suffix = name.rpartition(".")
        return name if self.count == 1 else f"{stem}.{self.index}{dot}{suffix}"

    def owns(self, episode: str) -> bool:
        """Whether an episode's recording is for this worker to go on with."""
        return self.count == 1 or self._of_id(episode) % self.count == self.index

    def check_here(self, name: str, code: str, code_length: int) -> None:
        """ElsewhereError if an id or a code belongs to another worker."""
        if self.count == 1:
            return
        if len(code) == code_length and code[0] in CODE_LETTERS:
            home = CODE_LETTERS.index(code[0]) % self.count
        elif len(name) == 16 and all(digit in "0123456789abcdef" for digit in name):
            home = self._of_id(name) % self.count
        else:
            return
        if home != self.index:
            url = self.url.replace("{worker}", str(home))
            raise ElsewhereError(name, self.first_port + home, url)

    def _of_id(self, episode: str) -> int:
        try:
            return int(episode[:2], 16)
        except ValueError:
            return 0
