"""Measure the overhead of model calls with many concurrent episodes in one process.

python -m benchmarks.model_calls --episodes 100 --calls 6

The endpoint is a separate process. Like a model, it takes about two seconds for an answer, and it
reports its own time. The rest of a call is overhead: SDK, HTTP, other calls in the same event loop,
and checks of the answer. Conversations are as long as those of an episode with full history. Needs
the extra `llm`.
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

from tests.support.openai_server import Received, Reply, answer, answering

from robotouille_evaluation.models import (
    Endpoint,
    Message,
    Model,
    ModelRequest,
    OpenAICompatibleModel,
    ScriptedModel,
)

TARGET = 0.005
"""Target for the median overhead in seconds."""
EXCHANGES, CHARACTERS = 20, 1500
"""Number of observations in a conversation, each with a short answer, and their length."""


@dataclass(frozen=True)
class Figures:
    """Overheads of calls, and processor time per call, in seconds."""

    overheads: list[float]
    processor: float

    @property
    def median(self) -> float:
        return median(self.overheads)

    @property
    def p99(self) -> float:
        return quantiles(self.overheads, n=100)[98]


def conversation(number: int) -> ModelRequest:
    """Return a long conversation that is different for each number."""
    observation = f"{number} " + "The lettuce is on the table. " * (CHARACTERS // 29)
    pair = (Message("user", observation), Message("assistant", "Reasoning: So.\nAction: Wait"))
    return ModelRequest((Message("system", "You cook."), *pair * EXCHANGES, pair[0]))


class TimedReply(Reply):
    """Answer whose text is the endpoint's time in seconds, including its own delays."""

    def encoded(self) -> bytes:
        took = time.perf_counter() - float(self.body)
        return answer(str(took)).encoded()


async def serve(thinking: float) -> None:
    """Serve until killed; answer each request after about `thinking` seconds."""

    def reply(_: Received) -> Reply:
        begun = str(time.perf_counter()).encode()
        return TimedReply(begun, delay=thinking * random.uniform(0.5, 1.5))

    async with answering(reply) as endpoint:
        print(endpoint.url, flush=True)
        await asyncio.Event().wait()


@contextmanager
def server(thinking: float) -> Iterator[str]:
    """Run the endpoint in a separate process and yield its base URL."""
    options = ["--serve", "--thinking", str(thinking)]
    command = [sys.executable, "-m", "benchmarks.model_calls", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.kill()


async def measure(model: Model, episodes: int, calls: int, thinking: float) -> Figures:
    """Return the overheads of `calls` calls in each of `episodes` concurrent episodes.

    Each episode first makes one call that is not measured, to open its connection.
    """
    overheads: list[float] = []

    async def play(number: int, calls: int) -> None:
        await asyncio.sleep(random.uniform(0, thinking))
        request = conversation(number)
        for _ in range(calls):
            begun = time.perf_counter()
            answered = await model.complete(request)
            overheads.append(time.perf_counter() - begun - float(answered.text))

    await asyncio.gather(*(play(number, 1) for number in range(episodes)))
    overheads.clear()
    begun = time.process_time()
    await asyncio.gather(*(play(number, calls) for number in range(episodes)))
    return Figures(overheads, (time.process_time() - begun) / (episodes * calls))


async def trial(url: str, episodes: int, calls: int, thinking: float) -> Figures:
    """Measure the overheads of calls to an endpoint."""
    endpoint = Endpoint("scripted", url)
    async with OpenAICompatibleModel(endpoint) as model:
        return await measure(model, episodes, calls, thinking)


def report(name: str, figures: Figures) -> None:
    met = "met" if figures.median < TARGET else "MISSED"
    print(
        f"  {name:<8} {figures.median * 1000:6.2f} ms (under {TARGET * 1000:g} ms: {met})"
        f"  p99 {figures.p99 * 1000:6.1f} ms  processor {figures.processor * 1000:5.2f} ms per call"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the measurement; `--serve` is internal."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--calls", type=int, default=6)
    parser.add_argument("--thinking", type=float, default=2.0, help="seconds per answer")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.serve:
        asyncio.run(serve(options.thinking))
        return
    how = (options.episodes, options.calls, options.thinking)
    print(f"Overhead of a model call, median, {options.episodes} concurrent episodes")
    report("scripted", asyncio.run(measure(ScriptedModel(lambda _: "0"), *how)))
    with server(options.thinking) as url:
        report("endpoint", asyncio.run(trial(url, *how)))


if __name__ == "__main__":
    main()
