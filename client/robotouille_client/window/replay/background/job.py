"""What all that is worked out beside a viewer has in common."""

from __future__ import annotations

from typing import Protocol

__all__ = ["Job", "toggle"]


class Job(Protocol):
    """Something that is begun on demand, one at a time; it tells the viewer's state how far it
    is."""

    @property
    def running(self) -> bool:
        """Whether it has begun and is neither done nor given up."""

    def start(self) -> None:
        """Begin."""

    def poll(self) -> None:
        """In each frame: take over what there is, and say how far it is or that it is done."""

    def stop(self) -> None:
        """Give it up, and say so."""

    def close(self) -> None:
        """Give it up, with nobody there to be told."""


def toggle(job: Job) -> None:
    """Begin a job, or stop it."""
    if job.running:
        job.stop()
    else:
        job.start()
