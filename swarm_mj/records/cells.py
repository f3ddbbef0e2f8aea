"""What a run tells of each cell of its target: one row a cell, with units and meanings, for tables, maps and meshes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.mission.target import place_of
from swarm_mj.observation.coverage import WORDS, Cause
from swarm_mj.observation.quality import Figures

#: Whether a quality class maps each cell is the array and the column of its name after this.
MAPPED = "mapped_"


class Quantity(NamedTuple):
    """What a column holds: a name for readers, its unit, and what it means."""

    title: str
    unit: str
    meaning: str


#: Columns in their order; those of which a run has nothing are left out.
QUANTITIES = {
    "cell": Quantity("cell", "1", "number of the cell, from 0"),
    "face": Quantity("face", "1", "face of the target that the cell lies in, from 0"),
    "latitude_deg": Quantity("latitude", "deg", "planetocentric latitude of the centroid"),
    "longitude_deg": Quantity("longitude", "deg", "east longitude of the centroid, -180 to 180"),
    "radius_m": Quantity("radius", "m", "distance of the centroid from the body's centre of mass"),
    "area_m2": Quantity("area", "m^2", "area of the cell"),
    "seen": Quantity("observed", "1", "whether it is observed by the scenario's criterion"),
    "first_seen_s": Quantity("first observed", "s", "when it was first observed, past the epoch"),
    "observers": Quantity("spacecraft that observed it", "1", "how many spacecraft observed it"),
    "gsd_m": Quantity(
        "ground sampling distance", "m", "finest of the pictures by which spacecraft keep it, obliquity included"
    ),
    "incidence_deg": Quantity("incidence of the Sun", "deg", "angle between normal and Sun in that picture"),
    "looks": Quantity("looks", "1", "pictures in which it counts"),
    "best_gsd_m": Quantity("finest ground sampling distance", "m", "least of all looks, obliquity included"),
    "least_emission_deg": Quantity("least emission", "deg", "least angle between normal and camera of all looks"),
    "least_incidence_deg": Quantity("least incidence", "deg", "least angle between normal and Sun of all looks"),
    "convergence_deg": Quantity("convergence", "deg", "largest angle between two lines of sight"),
    "light_varied_deg": Quantity("variation of light", "deg", "largest angle between two directions to the Sun"),
    "height_dop": Quantity("dilution of height", "1", "deviation of the height over best_gsd_m for a pixel's noise"),
    "slope_dop": Quantity("dilution of slopes", "1", "deviation of both slopes for a noise of the brightness of 1"),
    "albedo_dop": Quantity("dilution of albedo", "1", "deviation of the albedo over itself for the same noise"),
    "arrives_s": Quantity("on Earth", "s", "when its data are on Earth, past the epoch"),
    "cause": Quantity("cause", "", "why it is not observed"),
}


def quantity(name: str) -> Quantity:
    """What a column holds, those of quality classes included."""
    if name.startswith(MAPPED):
        return Quantity(f"class {name.removeprefix(MAPPED)}", "1", "whether its looks fulfil the quality class")
    return QUANTITIES[name]


def cells_table(arrays: Mapping[str, NDArray[Any]], delivery: Delivery | None = None) -> pd.DataFrame:
    """One row a cell of the target, columns as `QUANTITIES` says, of the arrays of coverage.npz."""
    corners = arrays["vertices"][arrays["faces"]]
    latitude_deg, longitude_deg = place_of(centroid := corners.mean(axis=1))
    gsd, cells = arrays["gsd_m"], np.arange(len(corners))
    finest = np.where(np.isnan(gsd), np.inf, gsd).argmin(axis=0)
    columns: dict[str, Any] = {
        "face": arrays["face_of_cell"],
        "latitude_deg": latitude_deg,
        "longitude_deg": longitude_deg,
        "radius_m": np.linalg.norm(centroid, axis=1),
        "area_m2": arrays["area"],
        "seen": ~np.isnan(arrays["first_seen_s"]),
        "first_seen_s": arrays["first_seen_s"],
        "observers": (~np.isnan(arrays["first_seen_by_s"])).sum(axis=0),
        "gsd_m": gsd[finest, cells],
        "incidence_deg": arrays["incidence_deg"][finest, cells],
        **{name: arrays[name] for name in Figures._fields if name in arrays},
        **{name: values for name, values in arrays.items() if name.startswith(MAPPED)},
        **({} if delivery is None else {"arrives_s": delivery.arrives_s}),
        "cause": [WORDS.get(Cause(cause), "") for cause in arrays["why"].tolist()],
    }
    return pd.DataFrame(columns).rename_axis("cell")
