"""What navigation by pictures would have left in a flight's telemetry."""

import json

import numpy as np


def with_pictures(telemetry):
    """The telemetry of a flight whose positions were known ever better, by a centroid, a limb, and a picture of no use."""
    shape, t = telemetry["r_BN_N"].shape, telemetry["time"].values
    off = np.zeros(shape)
    off[..., 0] = (100.0 * np.exp(-t / t[-1]))[:, None]
    sigma = np.zeros(shape)
    sigma[:] = [50.0, 10.0, 5.0]
    known = {
        "r_BN_N_estimate": (("time", "spacecraft", "xyz"), telemetry["r_BN_N"].values + off),
        "v_BN_N_estimate": (("time", "spacecraft", "xyz"), telemetry["v_BN_N"].values),
        "r_BN_N_sigma": (("time", "spacecraft", "xyz"), sigma),
        "r_BN_N_correlation": (("time", "spacecraft", "xyz"), np.zeros(shape)),
    }
    records = [
        {"t": float(share * t[-1]), "spacecraft": "sc1", "kind": kind, "why": why}
        for share, kind, why in ((0.2, "centroid", ""), (0.5, "limb", ""), (0.8, "landmarks", "dark"))
    ]
    found = telemetry.assign(known)
    found.attrs["navigation"] = json.dumps(records)
    return found
