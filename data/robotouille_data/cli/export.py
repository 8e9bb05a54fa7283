"""`robotouille data export` and `card`: a catalogue as a folder of files."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotouille.program import printable, tell
from robotouille_client.console import fail, name_and_value
from robotouille_client.console.progress import progress_bar
from robotouille_data.cli import export_options as options
from robotouille_data.cli.console import DatabaseOption, FolderOption, catalogue, errors_told

if TYPE_CHECKING:
    from robotouille_data.exports.exporting import Exported

__all__ = ["card", "export"]

NAME = re.compile(r"[a-z][a-z0-9_]{0,30}")
"""What a part may be called: a folder of this name is made."""


def export(
    out: options.Out,
    formats: options.Formats = None,
    folder: FolderOption = Path(),
    database: DatabaseOption = None,
    query: options.Query = "",
    label: options.Label = None,
    consent: options.Consent = "",
    no_names: options.NoNames = False,
    no_text: options.NoText = False,
    split: options.Split = "",
    split_by: options.SplitBy = "pair",
    system: options.System = None,
    per_decision: options.PerDecision = False,
    title: options.Title = "",
    description: options.Description = "",
    license_: options.License = "",
    contact: options.Contact = "",
    seconds: options.Seconds = 60.0,
) -> None:
    """Write episodes as a folder of files that other software loads, with codebook and card.

    The folder is whole in the end, or not there.
    """
    for strange in set(formats or ()) - set(options.FORMATS):
        fail(printable(f"--format {strange}: one of {', '.join(options.FORMATS)}"))
    with errors_told():
        from robotouille_data.exports.exporting import export as write
        from robotouille_data.exports.request import About, ExportFormat, Request

        request = Request(
            tuple(map(ExportFormat, dict.fromkeys(formats or ["parquet"]))),
            query,
            seconds,
            dict(name_and_value(each, "--label") for each in label or ()),
            name_and_value(consent, "--consent") if consent else None,
            names=not no_names,
            texts=not no_text,
            split=_shares(split),
            split_by=split_by,
            system=system.read_text(encoding="utf-8", errors="replace").strip() if system else "",
            per_decision=per_decision,
            about=About(title, description, license_, contact),
        )
        url = catalogue(database, folder)
        with progress_bar("episodes") as progress:
            found = write(url, out, request, progress)
    _tell(found, out)


def card(
    folder: Annotated[Path, typer.Argument(help="The folder of an export.")],
    title: options.Title = "",
    description: options.Description = "",
    license_: options.License = "",
    contact: options.Contact = "",
) -> None:
    """Print the card of an export, with another title, description, licence or contact if given."""
    about = {
        "title": title,
        "description": description,
        "license": license_,
        "contact": contact,
    }
    with errors_told():
        from robotouille_data.exports.card import rewrite_card

        text = rewrite_card(folder, {name: value for name, value in about.items() if value})
    for line in text.splitlines():
        tell(printable(line))


def _tell(found: Exported, out: Path) -> None:
    """What was written, what was left out, and what is wrong with episodes."""
    for number, fault in found.faults.items():
        tell(printable(f"episode {number}: {fault}"), err=True)
    left_out = [f"{count} by {name}" for name, count in found.left_out.items() if count]
    if left_out:
        tell(f"left out: {', '.join(left_out)}")
    parts = [f"{name} {count}" for name, count in found.episodes.items() if name]
    told = f" ({', '.join(parts)})" if parts else ""
    count = sum(found.episodes.values())
    tell(printable(f"{out}: {count} episode{'s' * (count != 1)}{told}"))


def _shares(text: str) -> dict[str, float]:
    """`train=0.8,test=0.2` as shares by name."""
    shares = {}
    for each in filter(None, text.split(",")):
        name, share = name_and_value(each, "--split")
        try:
            shares[name] = float(share)
        except ValueError:
            shares[name] = 0.0
        if not NAME.fullmatch(name) or not 0 < shares[name] < math.inf:
            fail(f"--split {printable(each)}: expected a name and a share above 0")
    whole = all(share.is_integer() for share in shares.values())
    if shares and not whole and not math.isclose(sum(shares.values()), 1, abs_tol=1e-6):
        fail(f"--split {printable(text)}: the shares sum to {sum(shares.values()):g}, not to 1")
    return shares
