"""The command `campaign`."""

from __future__ import annotations

import argparse

from swarm_mj.campaign.command import add_campaign
from swarm_mj.commands.common import DEFAULT_OUT


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    add_campaign(commands, DEFAULT_OUT)
