"""One game of Robotouille between the pages of an oTree experiment."""

import csv
from pathlib import Path

from otree.api import BaseConstants, BaseGroup, BasePlayer, BaseSubsession, Page, models


class C(BaseConstants):
    """Constants of the app.

    `LINKS` is the table that `robotouille episodes open` or the operator page has saved: a row for
    each group.
    """

    NAME_IN_URL = "cooking"
    PLAYERS_PER_GROUP = 2
    NUM_ROUNDS = 1
    LINKS = Path(__file__).with_name("opened.csv")


class Subsession(BaseSubsession):
    """All groups of a session."""


class Group(BaseGroup):
    """The players of one kitchen."""


class Player(BasePlayer):
    """A participant with a personal link, and the end of the game."""

    link = models.LongStringField()
    outcome = models.StringField()
    steps = models.IntegerField()


def creating_session(subsession: Subsession) -> None:
    """Give each player the link of a seat."""
    with C.LINKS.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    groups = subsession.get_groups()
    if len(rows) < len(groups):
        raise ValueError(f"{C.LINKS} has {len(rows)} episodes, and {len(groups)} groups need one")
    for row, group in zip(rows, groups, strict=False):
        for player in group.get_players():
            player.link = row[f"link.robot{player.id_in_group}"]


class Game(Page):
    """The page that shows the game, and ends with it."""

    form_model = "player"
    form_fields = ("outcome", "steps")

    @staticmethod
    def js_vars(player: Player) -> dict[str, str]:
        """Return what the page's script needs."""
        return {"link": player.link, "name": f"P{player.participant.id_in_session:02}"}


class Thanks(Page):
    """The page after the game."""


page_sequence = [Game, Thanks]
