"""The companion of a scenario's body: its mesh, field, path and rotation."""

from __future__ import annotations

from math import radians, sqrt, tau

import numpy as np

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_body import Body, MutualOrbit, MutualPath
from swarm_mj.scenarios.schema_body import Companion as CompanionKeys
from swarm_mj.smallbody.companion import KeplerianPath, RelativePath, SampledPath
from swarm_mj.smallbody.ephemeris import ephemeris_time, perifocal_axes
from swarm_mj.smallbody.kernel_ephemeris import KernelEphemeris
from swarm_mj.tracks.frames import axes_of_pole
from swarm_mj.typing import Array

#: Time between the samples of a path by a file [s], and how many at most.
SAMPLE_S, MAX_SAMPLES = 30.0, 100_000


def path_from(scenario: Scenario, asked: CompanionKeys, pole_N: Array) -> RelativePath:
    """Where the companion is; `pole_N` is that of the scenario's body, shape (3,).

    Raises:
        ScenarioError: Neither the period nor both gravitational parameters are given, or the file does not say.
    """
    if asked.orbit is not None:
        return keplerian_path(scenario.body, asked.body, asked.orbit, pole_N)
    assert asked.ephemeris is not None  # the schema sees to that
    return _path_of_file(scenario, asked.ephemeris)


def keplerian_path(body: Body, companion: Body, orbit: MutualOrbit, pole_N: Array) -> KeplerianPath:
    """The orbit in N; errors as for `path_from`."""
    axes = axes_of_pole(orbit.axes, pole_N)
    angles = (orbit.inclination_deg, orbit.node_deg, orbit.argument_of_periapsis_deg)
    P, Q = perifocal_axes(*(radians(angle) for angle in angles))
    a, period = orbit.semi_major_axis_m, orbit.period_s
    mean_motion = tau / period if period is not None else sqrt(_gm_of_both(body, companion) / a**3)
    return KeplerianPath(
        semi_major_axis=a,
        eccentricity=orbit.eccentricity,
        P_N=P @ axes,
        Q_N=Q @ axes,
        mean_anomaly=radians(orbit.mean_anomaly_deg),
        mean_motion=mean_motion,
    )


def _gm_of_both(body: Body, companion: Body) -> float:
    total = 0.0
    for key, one in (("body", body), ("companion.body", companion)):
        gm = one.gravity.parameters.get("gm")
        if not isinstance(gm, (int, float)) or not gm > 0.0:
            raise ScenarioError(
                f"companion.orbit.period_s = null: needs {key}.gravity.parameters.gm above 0, which is {gm}; give period_s"
            )
        total += gm
    return total


def _path_of_file(scenario: Scenario, asked: MutualPath) -> SampledPath:
    kernels = KernelEphemeris((*scenario.ephemerides.kernels, asked.spk), scenario.body.name, body=asked.body)
    count = min(MAX_SAMPLES, max(2, 2 + round(scenario.duration_s / SAMPLE_S)))
    times = np.linspace(0.0, scenario.duration_s, count)
    remedy = "give an SPK that holds both bodies for the whole flight"
    return SampledPath(
        times, kernels.states_N(asked.target, ephemeris_time(scenario.epoch) + times, "companion.ephemeris.spk", remedy)
    )
