"""Make the window's sounds and its music, from soft tones made of sine waves.

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


BEAT = 0.6
"""Seconds of a beat of the music. A bar has four."""
CHORDS = ((60, 64, 67), (57, 60, 64), (53, 57, 60), (55, 59, 62)) * 2
"""Chord of each bar, as MIDI notes. The first one is also the bass, an octave lower."""
MELODY = (
    "76 . 79 . 76 74 72 .", "69 . 72 . 76 . 72 .", "77 . 76 . 74 . 72 .", "74 . 67 . 71 74 . .",
    "76 . 79 . 81 79 76 .", "72 . 76 . 69 . 76 .", "72 . 69 . 65 69 72 .", "71 . 74 . 67 . . .",
)  # fmt: skip
"""Notes of each bar, eight to a bar; a dot is a rest."""


def music() -> Iterator[Tone]:
    """Yield the tones of the music, which begins again after its last bar."""
    for bar, (chord, melody) in enumerate(zip(CHORDS, MELODY, strict=True)):
        begin = bar * 4 * BEAT
        for beat, note in ((0, chord[0]), (2, chord[2] - 12)):
            yield _note(note - 12, 1.6 * BEAT, begin + beat * BEAT, 0.5)
        for beat in (1, 3):
            for note in chord:
                yield _note(note, 0.8 * BEAT, begin + beat * BEAT, 0.16)
        for eighth, played in enumerate(melody.split()):
            if played != ".":
                yield _note(int(played), 1.2 * BEAT, begin + eighth * BEAT / 2, 0.45)


def _note(number: int, length: float, rest: float, loud: float) -> Tone:
    """Return a MIDI note, in equal temperament with A at 440 Hz."""
    frequency = 440 * 2 ** ((number - 69) / 12)
    return Tone(frequency, frequency, length, rest, loud)


def samples(tones: tuple[Tone, ...], whole: float | None = None) -> list[int]:
    """Return a sound as 16-bit samples.

    Args:
        whole: Seconds of a sound that is repeated. Tones that last longer go on at its start.
            Default: the sound ends with its last tone.
    """
    length = whole or max(tone.rest + tone.length for tone in tones)
    mixed = [0.0] * round(length * RATE)
    for tone in tones:
        start = round(tone.rest * RATE)
        for i, value in enumerate(_wave(tone)):
            if whole or start + i < len(mixed):
                mixed[(start + i) % len(mixed)] += value
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
    """Write all sounds, and the music."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--out", type=Path, default=FOLDER, help="output folder instead of assets/sounds"
    )
    out = parser.parse_args(arguments).out
    out.mkdir(parents=True, exist_ok=True)
    sounds = {name: samples(tones) for name, tones in SOUNDS.items()}
    sounds["music"] = samples(tuple(music()), whole=4 * BEAT * len(CHORDS))
    for name, values in sounds.items():
        with wave.open(str(out / f"{name}.wav"), "wb") as file:
            file.setnchannels(1)
            file.setsampwidth(2)
            file.setframerate(RATE)
            file.writeframes(struct.pack(f"<{len(values)}h", *values))


if __name__ == "__main__":
    main()
