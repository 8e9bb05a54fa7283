"""`robotouille data export` and `card`: a catalogue as a folder of files."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated

import typer

from robotouille.program import printable, tell
from robotouille_client.console import fail, name_and_value
from robotouille_client.console.progress import progress_bar
from robotouille_data.cli.console import DatabaseOption, FolderOption, catalogue, errors_told

__all__ = ["card", "export"]

NAME = re.compile(r"[a-z][a-z0-9_]{0,30}")
"""What a part may be called: a folder of this name is made."""
FORMATS = ("parquet", "csv", "jsonl", "chat", "minari", "arrays")

TitleOption = Annotated[str, typer.Option(help="What the data set is called.")]
DescriptionOption = Annotated[str, typer.Option(help="What it is, in a few sentences.")]
LicenseOption = Annotated[
    str, typer.Option("--license", help="An identifier of SPDX, as CC-BY-4.0.")
]
ContactOption = Annotated[str, typer.Option(help="Whom one may ask.")]


def export(
    out: Annotated[Path, typer.Argument(help="A new folder.")],
    formats: Annotated[
        list[str] | None,
        typer.Option("--format", help=f"{', '.join(FORMATS)}; several may be given."),
    ] = None,
    folder: FolderOption = Path(),
    database: DatabaseOption = None,
    query: Annotated[
        str, typer.Option(help="SQL with a column `id` or `episode_id`: only these episodes.")
    ] = "",
    label: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="Only with all these labels.")
    ] = None,
    consent: Annotated[
        str, typer.Option(metavar="NAME=VALUE", help="Only episodes whose label gives consent.")
    ] = "",
    no_names: Annotated[
        bool, typer.Option("--no-names", help="Names and pseudonyms become p1, p2, …")
    ] = False,
    no_text: Annotated[
        bool, typer.Option("--no-text", help="Leave out what people and models have written.")
    ] = False,
    split: Annotated[str, typer.Option(metavar="PART=SHARE,…", help="As train=0.8,test=0.2.")] = "",
    split_by: Annotated[
        str, typer.Option(help="Episodes with one value of this label stay together.")
    ] = "pair",
    system: Annotated[
        Path | None, typer.Option(help="Chat: a file with what each conversation begins with.")
    ] = None,
    per_decision: Annotated[
        bool, typer.Option("--per-decision", help="Chat: a conversation for each decision.")
    ] = False,
    title: TitleOption = "",
    description: DescriptionOption = "",
    license_: LicenseOption = "",
    contact: ContactOption = "",
    seconds: Annotated[float, typer.Option(min=0.001, help="How long the query may take.")] = 60.0,
) -> None:
    """Write episodes as a folder of files that other software loads, with codebook and card.

    The folder is whole in the end, or not there.
    """
    for strange in set(formats or ()) - set(FORMATS):
        fail(printable(f"--format {strange}: one of {', '.join(FORMATS)}"))
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
    for number, fault in found.faults.items():
        tell(printable(f"episode {number}: {fault}"), err=True)
    left_out = [f"{count} by {name}" for name, count in found.left_out.items() if count]
    if left_out:
        tell(f"left out: {', '.join(left_out)}")
    parts = [f"{name} {count}" for name, count in found.episodes.items() if name]
    told = f" ({', '.join(parts)})" if parts else ""
    count = sum(found.episodes.values())
    tell(printable(f"{out}: {count} episode{'s' * (count != 1)}{told}"))


def card(
    folder: Annotated[Path, typer.Argument(help="The folder of an export.")],
    title: TitleOption = "",
    description: DescriptionOption = "",
    license_: LicenseOption = "",
    contact: ContactOption = "",
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
