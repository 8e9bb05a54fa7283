"""What our side of a model call costs, with many episodes at once in one process.

python -m benchmarks.model_calls --episodes 100 --calls 10

The endpoint is another process. It takes between one and three seconds for an answer, as models
do, and says how long it took; what a call takes beyond that is overhead: SDK, HTTP, waiting for the
other episodes' calls in the same event loop, checks of the answer. The conversations are as long as
those of an episode with its whole history. It needs the extra `llm`.
"""

from __future__ import annotations

import argparse
import asyncio
import random
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import median, quantiles

from robotouille_evaluation.models import (
    Endpoint,
    Message,
    Model,
    ModelRequest,
    OpenAICompatibleModel,
    ScriptedModel,
)
from tests.support.openai_server import Received, Reply, answer, answering

TARGET = 0.005
"""Seconds of overhead at most, in the median."""
EXCHANGES, CHARACTERS = 20, 1500
"""A conversation: so many observations, each so long, and as many short answers."""
THINKING = (1.0, 3.0)


@dataclass(frozen=True)
class Figures:
    """Overheads of calls and the processor's time for one, in seconds."""

    overheads: list[float]
    processor: float

    @property
    def median(self) -> float:
        return median(self.overheads)

    @property
    def p99(self) -> float:
        return quantiles(self.overheads, n=100)[98]


def conversation(number: int) -> ModelRequest:
    """A long conversation, another for each number."""
    observation = f"{number} " + "The lettuce is on the table. " * (CHARACTERS // 29)
    pair = (Message("user", observation), Message("assistant", "Reasoning: So.\nAction: Wait"))
    return ModelRequest((Message("system", "You cook."), *pair * EXCHANGES, pair[0]))


class TimedReply(Reply):
    """An answer whose text says how long it took, the endpoint's own lateness included."""

    def encoded(self) -> bytes:
        took = time.perf_counter() - float(self.body)
        return answer(str(took)).encoded()


def reply(_: Received) -> Reply:
    begun = str(time.perf_counter()).encode()
    return TimedReply(begun, delay=random.uniform(*THINKING))


async def serve() -> None:
    """Answer until killed."""
    async with answering(reply) as endpoint:
        print(endpoint.url, flush=True)
        await asyncio.Event().wait()


@contextmanager
def server() -> Iterator[str]:
    """The endpoint in a process of its own; its base URL."""
    command = [sys.executable, "-m", "benchmarks.model_calls", "--serve"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.kill()


async def measure(model: Model, episodes: int, calls: int) -> Figures:
    """The overheads of so many calls in each of so many episodes at once."""
    overheads: list[float] = []

    async def play(number: int) -> None:
        await asyncio.sleep(random.uniform(0, THINKING[1]))
        for turn in range(calls):
            request = conversation(number)
            begun = time.perf_counter()
            answered = await model.complete(request)
            took = time.perf_counter() - begun - float(answered.text)
            if turn or calls == 1:  # the first call opens the connection
                overheads.append(took)

    begun = time.process_time()
    await asyncio.gather(*(play(number) for number in range(episodes)))
    return Figures(overheads, (time.process_time() - begun) / (episodes * calls))


async def trial(url: str, episodes: int, calls: int) -> Figures:
    """The overheads with an endpoint."""
    endpoint = Endpoint("scripted", url, max_concurrent=episodes)
    async with OpenAICompatibleModel(endpoint) as model:
        return await measure(model, episodes, calls)


def report(name: str, figures: Figures) -> None:
    met = "met" if figures.median < TARGET else "MISSED"
    print(
        f"  {name:<10} {figures.median * 1000:6.2f} ms (under {TARGET * 1000:g} ms: {met})"
        f"  p99 {figures.p99 * 1000:6.1f} ms  processor {figures.processor * 1000:5.2f} ms a call"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure; `--serve` is for the program itself."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--calls", type=int, default=10)
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.serve:
        asyncio.run(serve())
        return
    print(f"Overhead of a model call, median of {options.episodes} episodes at once")
    scripted = ScriptedModel(lambda _: "0")
    report("scripted", asyncio.run(measure(scripted, options.episodes, options.calls)))
    with server() as url:
        report("endpoint", asyncio.run(trial(url, options.episodes, options.calls)))


if __name__ == "__main__":
    main()
