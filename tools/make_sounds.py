"""Make the window's sounds, a few soft tones made of sine waves.

python tools/make_sounds.py [--out FOLDER]
"""

from __future__ import annotations

import argparse
import math
import struct
import wave
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "assets" / "sounds"
RATE = 11025
LOUDEST = 0.25


@dataclass(frozen=True)
class Tone:
    """Fading note that glides from `low` to `high` Hz; `length` and `rest` are in seconds."""

    low: float
    high: float
    length: float
    rest: float = 0.0
    loud: float = 1.0


SOUNDS: dict[str, tuple[Tone, ...]] = {
    "walk": (Tone(190, 140, 0.05, loud=0.5),),
    "take": (Tone(420, 640, 0.09),),
    "put": (Tone(420, 260, 0.10),),
    "work": (Tone(300, 220, 0.05), Tone(300, 220, 0.05, rest=0.08)),
    "ready": (Tone(660, 660, 0.14), Tone(990, 990, 0.2, rest=0.1)),
    "refused": (Tone(200, 180, 0.11), Tone(160, 150, 0.14, rest=0.12)),
    "said": (Tone(720, 760, 0.07), Tone(860, 860, 0.08, rest=0.08)),
    "won": (
        Tone(523, 523, 0.22), Tone(659, 659, 0.22, rest=0.13), Tone(784, 784, 0.24, rest=0.26),
        Tone(1047, 1047, 0.45, rest=0.4),
    ),
    "lost": (Tone(392, 392, 0.25), Tone(330, 330, 0.25, rest=0.2), Tone(262, 250, 0.5, rest=0.4)),
}  # fmt: skip


def samples(tones: tuple[Tone, ...]) -> list[int]:
    """Return a sound as 16-bit samples."""
    whole = max(tone.rest + tone.length for tone in tones)
    mixed = [0.0] * round(whole * RATE)
    for tone in tones:
        start = round(tone.rest * RATE)
        for i, value in enumerate(_wave(tone)):
            if start + i < len(mixed):
                mixed[start + i] += value
    return [round(32767 * max(-1.0, min(1.0, value))) for value in mixed]


def _wave(tone: Tone) -> Iterator[float]:
    """Yield a sine and a little of its octave, with 5 ms of attack and a slow decay."""
    count, turn = round(tone.length * RATE), 0.0
    for i in range(count):
        along = i / count
        turn += math.tau * (tone.low + (tone.high - tone.low) * along) / RATE
        swell = min(1.0, i / (0.005 * RATE)) * (1 - along) ** 1.5
        yield LOUDEST * tone.loud * swell * (math.sin(turn) + 0.2 * math.sin(2 * turn))


def main(arguments: Sequence[str] | None = None) -> None:
    """Write all sounds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--out", type=Path, default=FOLDER, help="output folder instead of assets/sounds"
    )
    out = parser.parse_args(arguments).out
    out.mkdir(parents=True, exist_ok=True)
    for name, tones in SOUNDS.items():
        values = samples(tones)
        with wave.open(str(out / f"{name}.wav"), "wb") as file:
            file.setnchannels(1)
            file.setsampwidth(2)
            file.setframerate(RATE)
            file.writeframes(struct.pack(f"<{len(values)}h", *values))


if __name__ == "__main__":
    main()
