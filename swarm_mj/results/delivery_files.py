"""delivery.npz: what became of the data of a flight, array by array as `swarm_mj.dataflow.delivery.Delivery` tells."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.io.arrays import Declared, read_arrays
from swarm_mj.mission.links import Obstacle
from swarm_mj.simulator.telemetry import FARTHEST, REMEDY

NAME = "delivery.npz"
#: Largest number of bits, or of a station, and latest time [s], that a file may hold.
_MOST_BIT, _LATEST_S = 2.0**62, 1e12
_LINKS, _WAYS, _HELD = ("slots", "spacecraft", "spacecraft"), ("slots", "spacecraft"), ("edges", "spacecraft")
_TILES, _COPIES = ("tiles",), ("spacecraft", "tiles")
#: Arrays of delivery.npz, as they are written and as they must be to be read.
DELIVERY = {
    "edges_s": Declared("f8", ("edges",), -_LATEST_S, _LATEST_S, rising=True),
    "light_time_s": Declared("f8", ("slots",), 0.0, _LATEST_S),
    "contact_bit": Declared("i8", _LINKS, 0, _MOST_BIT),
    "earth_contact_bit": Declared("i8", _WAYS, 0, _MOST_BIT),
    "station": Declared("i8", _WAYS, -1, 1000),
    "why_swarm": Declared("i1", _LINKS, 0, max(Obstacle)),
    "why_earth": Declared("i1", _WAYS, 0, max(Obstacle)),
    "relay_distance_m": Declared("f8", _WAYS, 0.0, FARTHEST, gaps="nan"),
    "sent_bit": Declared("i8", _LINKS, 0, _MOST_BIT),
    "earth_bit": Declared("i8", _WAYS, 0, _MOST_BIT),
    "aboard_bit": Declared("i8", _HELD, 0, _MOST_BIT),
    "lost_bit": Declared("i8", _HELD, 0, _MOST_BIT),
    "tile_of_cell": Declared("i8", ("cells",), -1, "tiles"),
    "tile_area": Declared("f8", _TILES, 0.0, FARTHEST**2),
    "tile_bit": Declared("i8", _COPIES, 0, _MOST_BIT),
    "tile_lost_bit": Declared("i8", _COPIES, 0, _MOST_BIT),
    "tile_overflow_bit": Declared("i8", _COPIES, 0, _MOST_BIT),
    "tile_ready_s": Declared("f8", _COPIES, 0.0, _LATEST_S, gaps="nan"),
    "tile_arrives_s": Declared("f8", _TILES, 0.0, _LATEST_S, gaps="nan"),
    "best_earth_bit": Declared("f8", _WAYS, 0.0, _MOST_BIT, gaps="nan"),
    "best_share": Declared("f8", _TILES, 0.0, 1.0 + 1e-6, gaps="nan"),
    "best_full_s": Declared("f8", (), 0.0, _LATEST_S, gaps="nan"),
    "best_bound_area": Declared("f8", (), 0.0, FARTHEST**2, gaps="nan"),
    "election_s": Declared("f8", ("elections",), -_LATEST_S, _LATEST_S, rising=True),
    "elected": Declared("?", ("elections", "spacecraft")),
}
#: Where nothing was seen.
MAY_BE_EMPTY = (
    "tile_area",
    "tile_bit",
    "tile_lost_bit",
    "tile_overflow_bit",
    "tile_ready_s",
    "tile_arrives_s",
    "best_share",
)


def write_delivery(folder: Path, delivery: Delivery) -> None:
    """Write delivery.npz into a folder."""
    np.savez_compressed(folder / NAME, **vars(delivery))


def read_delivery(folder: Path, **sizes: int) -> Delivery | None:
    """The delivery of a run; None where the run has none.

    Args:
        folder: Of the run.
        **sizes: `spacecraft` and `cells`, where they are known.

    Raises:
        OutputError: The file cannot be read, or an array is missing or not as `DELIVERY` says.
    """
    path = folder / NAME
    if not path.is_file():
        return None
    return Delivery(**read_arrays(path, DELIVERY, REMEDY, sizes=sizes, may_be_empty=MAY_BE_EMPTY))
