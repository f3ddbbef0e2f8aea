"""What a flight's coordination cost and came to: in its telemetry, its summary, and taken from the crosslink's capacity."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from swarm_mj.coordination.swarm_flight import SwarmFlight
from swarm_mj.dataflow.contacts import Contacts
from swarm_mj.dataflow.network import Access
from swarm_mj.simulator.telemetry import VARIABLES
from swarm_mj.typing import Array

#: Variables of the telemetry.
BITS, AIRTIME = "coordination_bits", "coordination_airtime"
#: Of the messages by which a formation is held.
FORMATION_AIRTIME = "formation_airtime"


def record_coordination(telemetry: xr.Dataset, behavior: Any) -> None:
    """Add what the messages of a coordinated swarm came to; nothing where the behaviour is another or sends none."""
    if not isinstance(behavior, SwarmFlight) or not behavior.mission.talks:
        return
    log, time = behavior.log, telemetry["time"].values
    # What was sent by each sample: nothing before the first.
    at = np.searchsorted(log.time_s, time + 1e-6) - 1
    n = telemetry.sizes["spacecraft"]
    bits = np.array([np.zeros(n, np.int64), *log.bits])[at + 1]
    airtime = np.array([np.zeros(n), *log.airtime_s])[at + 1]
    for name, values in ((BITS, bits), (AIRTIME, airtime)):
        telemetry[name] = VARIABLES[name].of(values)
    names = telemetry["spacecraft"].values
    told = [{**event._asdict(), "spacecraft": str(names[event.spacecraft])} for event in log.events]
    telemetry.attrs["coordination_events"] = json.dumps(told)


def coordination_summary(telemetry: xr.Dataset) -> dict[str, Any]:
    """Keys of the summary; empty for flights without messages."""
    if BITS not in telemetry:
        return {}
    return {
        "coordination_bits": int(telemetry[BITS].values[-1].sum()),
        "coordination_airtime_s": float(telemetry[AIRTIME].values[-1].sum()),
        "coordination_events": json.loads(telemetry.attrs["coordination_events"]),
    }


def less_coordination(contacts: Contacts, telemetry: xr.Dataset, access: Access) -> Contacts:
    """What the crosslinks can carry besides the swarm's own messages: in each slot, by the time that these took.

    Args:
        contacts: Without messages.
        telemetry: Of the flight.
        access: How the channel is shared: of all, or of each sender.
    """
    told = [telemetry[name].values for name in (AIRTIME, FORMATION_AIRTIME) if name in telemetry]
    if not told:
        return contacts
    time, airtime = telemetry["time"].values, np.sum(told, axis=0)
    spent: Array = np.array([np.interp(contacts.edges_s, time, airtime[:, j]) for j in range(airtime.shape[1])])
    share = np.diff(spent, axis=1).T / np.diff(contacts.edges_s)[:, None]
    if access is Access.ONE_AT_A_TIME:
        share = np.broadcast_to(share.sum(axis=1, keepdims=True), share.shape)
    elif access is Access.TDMA:
        share = share * share.shape[1]
    left = np.maximum(1.0 - share, 0.0)[:, :, None]
    return replace(contacts, swarm_bit=np.floor(contacts.swarm_bit * left).astype(np.int64))
