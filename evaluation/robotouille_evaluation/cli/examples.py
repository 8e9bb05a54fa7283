"""`robotouille benchmark examples`: recordings become in-context examples of a pack."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotouille.terminal import printable, tell
from robotouille_client.console import failing

if TYPE_CHECKING:
    from robotouille_evaluation.packs.pack import Pack


@failing
def examples(
    recordings: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Recordings that reach their goal.")
    ],
    out: Annotated[Path, typer.Option(help="Folder of the new pack.")],
    pack: Annotated[
        Path, typer.Option(help="Folder or name of the pack that gets the examples.")
    ] = Path("ours"),
    datasets: Annotated[
        str, typer.Option(help="Data sets in which the examples are shown. Default: all.")
    ] = "",
    seat: Annotated[
        str, typer.Option(help="Seat of a team whose actions are shown, such as robot2.")
    ] = "",
) -> None:
    """Make a pack whose in-context examples are recorded episodes of people or bots.

    Language models are shown the examples before each request (`benchmark run --pack OUT`).
    """
    from robotouille.replay import read_recording
    from robotouille_evaluation.cli.planning import comma_separated
    from robotouille_evaluation.packs.built_in import find_pack
    from robotouille_evaluation.packs.example_episodes import episodes_by_form
    from robotouille_evaluation.packs.recorded_examples import recorded_choices, with_examples
    from robotouille_evaluation.packs.store import write_pack

    base = find_pack(pack)
    episodes, tasks = [], []
    for path in recordings:
        recording = read_recording(path)
        choices = recorded_choices(recording, seat)
        episodes.append(episodes_by_form(path.stem, choices))
        tasks.append(recording.task.name)
        tell(printable(f"{path}: {recording.task.name}, {len(choices)} actions"), err=True)
    made = with_examples(base, out.resolve().name, episodes, comma_separated(datasets))
    write_pack(made, out)
    for name in _evaluated(made, tasks):
        tell(
            printable(f"{name} is also a task of the pack: a run with this task shows its answer"),
            err=True,
        )
    tell(str(out))


def _evaluated(pack: Pack, tasks: Iterable[str]) -> Iterator[str]:
    """Yield the tasks of recordings that runs of the pack play, too."""
    played = {name for each in pack.instances for name in (each.id, each.task)}
    yield from (name for name in dict.fromkeys(tasks) if name in played)
