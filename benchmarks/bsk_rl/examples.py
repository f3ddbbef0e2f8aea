"""The examples of bsk_rl's documentation, with five satellites.

`scanning` is its Getting Started example (https://avslab.github.io/bsk_rl/examples/simple_environment.html), written for one
satellite; `imaging` its Multi-Agent Environments example (.../examples/multiagent_envs.html), written for three. Parameters
are those of the examples, but for the number of satellites and, in `scanning_10s`, the duration of the actions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from bsk_rl import GeneralSatelliteTasking, act, comm, data, obs, sats, scene
from bsk_rl.sim import dyn, fsw
from bsk_rl.utils.orbital import walker_delta_args

SATELLITES = 5
#: About one orbit: the examples' own limit, or the one given to the example that has none [s].
TIME_LIMIT_S = 5_700.0


class Scanner(sats.AccessSatellite):
    """Scans the ground below or charges its batteries."""

    observation_spec = [
        obs.SatProperties(dict(prop="storage_level_fraction"), dict(prop="battery_charge_fraction")),
        obs.Eclipse(),
    ]
    action_spec = [act.Scan(duration=60.0), act.Charge(duration=600.0)]
    dyn_type = dyn.ContinuousImagingDynModel
    fsw_type = fsw.ContinuousImagingFSWModel


class ShortScanner(Scanner):
    """The same, asked every 10 s."""

    action_spec = [act.Scan(duration=10.0), act.Charge(duration=10.0)]


class Imager(sats.ImagingSatellite):
    """Turns to one of the ten next ground targets and takes its picture."""

    observation_spec = [
        obs.OpportunityProperties(
            dict(prop="priority"), dict(prop="opportunity_open", norm=TIME_LIMIT_S), n_ahead_observe=10
        )
    ]
    action_spec = [act.Image(n_ahead_image=10)]
    dyn_type = dyn.FullFeaturedDynModel
    fsw_type = fsw.SteeringImagerFSWModel


SCANNER = dict(
    imageAttErrorRequirement=0.05,
    dataStorageCapacity=1e10,
    instrumentBaudRate=1e7,
    storedCharge_Init=50_000.0,
    storageInit=lambda: np.random.uniform(0.25, 0.75) * 1e10,
)
IMAGER = dict(
    imageAttErrorRequirement=0.01,
    imageRateErrorRequirement=0.01,
    batteryStorageCapacity=1e9,
    storedCharge_Init=1e9,
    dataStorageCapacity=1e12,
    u_max=0.4,
    K1=0.25,
    K3=3.0,
    omega_max=0.087,
    servo_Ki=5.0,
    servo_P=150 / 5,
)


def scanning(kind: type[Scanner] = Scanner) -> Any:
    """Five satellites on orbits of their own scan what is below them."""
    return GeneralSatelliteTasking(
        satellites=[kind(f"EO{j + 1}", dict(SCANNER)) for j in range(SATELLITES)],
        scenario=scene.UniformNadirScanning(),
        rewarder=data.ScanningTimeReward(),
        time_limit=TIME_LIMIT_S,
        log_level="ERROR",
    )


def imaging() -> Any:
    """Five satellites on one orbit image 1,000 targets and tell each other while they are in sight."""
    return GeneralSatelliteTasking(
        satellites=[Imager(f"EO{j + 1}", dict(IMAGER)) for j in range(SATELLITES)],
        scenario=scene.UniformTargets(1000),
        rewarder=data.UniqueImageReward(),
        communicator=comm.LOSCommunication(),
        sat_arg_randomizer=walker_delta_args(altitude=800.0, inc=60.0, n_planes=1),
        time_limit=TIME_LIMIT_S,
        log_level="ERROR",
    )


EXAMPLES = {"scanning": scanning, "scanning_10s": lambda: scanning(ShortScanner), "imaging": imaging}
