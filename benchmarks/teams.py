"""Planner bots in teams: steps by the certified plan, with a person who stands still, over sockets.

    python -m benchmarks.teams                      # every multi-agent task, 2, 3 and 4 bots
    python -m benchmarks.teams --idle               # each seat in turn a person who stands still
    python -m benchmarks.teams --network 01 04@3    # real servers and sockets, in lockstep
    python -m benchmarks.teams --seats 2 --clock realtime 01 09

In process the bots are asked as over the network: what is refused is decided anew, and what they
say is heard by all. Thinking is in plain Python, as bots think.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("ROBOTOUILLE_COMPILE", "0")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from robotouille import World, load_task
from robotouille.certification.dataset import task_certificate
from robotouille.domain.task import Task
from robotouille.episode import Clock, Outcome
from robotouille_client.bots.kinds import BotKind, policy_maker
from tests.support.bot_games import finish
from tests.support.team_games import Idle, play_team
from tests.support.virtual_time import run
