"""What a campaign swept: the designs on its grid, each a group of runs of its own.

Runs of different designs are no sample of anything, so that a probability over all of them says nothing. What is random within
a design (dispersions, faults, attitudes) makes no groups.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow as pa

from swarm_mj.campaigns.config import Campaign
from swarm_mj.campaigns.sampling import Sample

#: Longest value of a swept key in a label.
LONGEST = 24


def swept(campaign: Campaign) -> list[str]:
    """Keys that take several values on the campaign's grid; none where it has no grid."""
    if campaign.method != "grid":
        return []
    return [key for key, law in campaign.parameters.items() if law.count > 1]


def groups(campaign: Campaign, rows: pa.Table) -> Iterator[tuple[dict[str, Any], pa.Table]]:
    """The rows of one scenario by point of the grid, in its order: the swept values, and the rows that were flown with them."""
    keys, sample = swept(campaign), Sample(campaign)
    if not keys:
        return
    place = np.array(rows["run"].to_pylist(), np.int64) // campaign.runs
    for number in np.unique(place).tolist():
        values = sample.grid_point(number)
        yield {key: values[key] for key in keys}, rows.filter(pa.array(place == number))


def label_of(values: dict[str, Any]) -> str:
    """Swept values in a few words: `half_angle_deg=5, rows=2`."""
    return ", ".join(f"{key.rpartition('.')[2]}={value_label(value)}" for key, value in values.items())


def value_label(value: Any) -> str:
    """A swept value in a few words."""
    if isinstance(value, float):
        return f"{value:.4g}"
    words = value if isinstance(value, str) else json.dumps(value)
    return words if len(words) <= LONGEST else words[: LONGEST - 3] + "..."
