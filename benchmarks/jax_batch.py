"""Speed of `JaxBatch` on every device that JAX finds, with agreement with `BatchWorld`.

python -m benchmarks.jax_batch [--platforms gpu,cpu] [--copies 1024,4096] [--out FILE.csv]

A step includes a random valid action for each player, which needs the masks, and the vectors. The
whole loop of a measurement is one compiled function.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from pathlib import Path

import jax
import numpy as np

from robotouille import World
from robotouille.batch import BatchWorld
from robotouille.compiling import COMPILED
from robotouille_jax import JaxBatch

TASKS = ("synchronous/01", "training/03@2", "multi_agent/01@2", "multi_agent/10@4")
STEPS = 50


def measure_jax(world: World, copies: int, device: jax.Device) -> tuple[float, float]:
    """Return steps per second and the time to compile."""
    with jax.default_device(device):
        batch = JaxBatch(world, copies, auto_reset=True)
        began = time.perf_counter()
        play = jax.jit(lambda states, key: batch.play_random(states, key, STEPS))
        run = play.lower(batch.states, jax.random.key(0)).compile()
        compiled = time.perf_counter() - began
        jax.block_until_ready(run(batch.states, jax.random.key(0)))
        began = time.perf_counter()
        jax.block_until_ready(run(batch.states, jax.random.key(1)))
        return copies * STEPS / (time.perf_counter() - began), compiled


def measure_numpy(world: World, copies: int) -> float:
    """Return the steps per second of `BatchWorld` on one core, after it is compiled."""
    batch = BatchWorld(world, copies, auto_reset=True)
    batch.step(batch.random_actions())
    batch.vectors()
    began, taken = time.perf_counter(), 0
    while time.perf_counter() - began < 1.0:
        batch.step(batch.random_actions())
        batch.vectors()
        taken += copies
    return taken / (time.perf_counter() - began)


def disagreements(world: World, copies: int, device: jax.Device, steps: int = 100) -> int:
    """Return the number of copies that differ from `BatchWorld` after any of many random steps."""
    with jax.default_device(device):
        reference = BatchWorld(world, copies, seed=1, auto_reset=True)
        batch = JaxBatch(world, copies, auto_reset=True)
        wrong = np.zeros(copies, dtype=np.bool_)
        for _ in range(steps):
            actions = reference.random_actions()
            expected, found = reference.step(actions), batch.step(actions)
            wrong |= (np.asarray(found.applied) != expected.applied).any(axis=1)
            wrong |= np.asarray(found.terminated) != expected.terminated
            wrong |= (np.asarray(batch.vectors()) != reference.vectors()).any(axis=1)
            wrong |= (np.asarray(batch.joint_masks()) != reference.joint_masks()).any(axis=1)
        return int(wrong.sum())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--copies", default="1024,4096,16384,65536")
    parser.add_argument("--platforms", default="gpu,cpu", help="of those that JAX finds")
    parser.add_argument("--compared", type=int, default=256, help="copies compared")
    parser.add_argument("--tasks", default=",".join(TASKS))
    parser.add_argument("--out", type=Path, help="a table, to which rows are added")
    asked = parser.parse_args()
    file = asked.out.open("a", newline="", encoding="utf-8") if asked.out else sys.stdout
    writer = csv.writer(file)
    if not asked.out or not file.tell():
        writer.writerow(("task", "engine", "device", "copies", "steps_per_second", "compile_s"))
    found = {device.platform: device for device in (*jax.devices("cpu")[:1], jax.devices()[0])}
    devices = {
        platform: found[platform] for platform in asked.platforms.split(",") if platform in found
    }
    for name in asked.tasks.split(","):
        world = World(name)
        for platform, device in devices.items():
            if world.shift is None:
                wrong = disagreements(world, asked.compared, device)
                print(f"{name} on {platform}: {wrong} of {asked.compared} copies differ")
            for number in map(int, asked.copies.split(",")):
                speed, compiled = measure_jax(world, number, device)
                writer.writerow((name, "jax", device, number, f"{speed:.0f}", f"{compiled:.1f}"))
                file.flush()
        if COMPILED and "cpu" in devices and world.shift is None:
            writer.writerow((name, "numba", "cpu", 1024, f"{measure_numpy(world, 1024):.0f}", ""))
            file.flush()


if __name__ == "__main__":
    main()
