"""A whole flight with a narrow camera, flown attitudes included, against exact polygons."""

import numpy as np
import pytest

from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.observation.camera import CameraModel, CameraPose
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.spacecraft.attitude.mrp import dcm

from .scenes import eros_oracle, exact_view

NARROW = ["camera.half_angle_deg=3", "observation.observer=faceid", "target.cell_size_m=auto"]


def flown_views(plan, telemetry):
    """Every picture of the flight, rebuilt from the telemetry alone."""
    camera = CameraModel(half_angle_deg=3.0)
    views = []
    for k in range(0, telemetry.sizes["time"], 10):
        C_AN = dcm(telemetry["sigma_AN"].values[k])
        for j in np.flatnonzero(telemetry["mode"].values[k, : plan.n_observers] == 0):
            C_CA = dcm(telemetry["sigma_BN"].values[k, j]) @ C_AN.T
            views.append(exact_view(CameraPose(C_AN @ telemetry["r_BN_N"].values[k, j], C_CA), camera))
    return views


@pytest.mark.gl
@pytest.mark.slow
def test_accumulated_coverage_of_the_papers_flight_with_a_3_degree_camera_agrees_with_the_oracle():
    plan = make_plan(load_scenario("eros-literal", parse_overrides(NARROW)))
    telemetry = simulate(plan)
    result = observe_flight(plan, telemetry)
    oracle = eros_oracle()
    views = flown_views(plan, telemetry)
    exact = 100 * oracle.united_area(views).sum() / oracle.area.sum()
    print(
        f"P_TO {result.coverage.percent:.2f} %, exact {exact:.2f} %, {len(views)} pictures, {plan.region.n_cells} cells"
    )
    assert len(views) == result.images
    assert 5.0 < exact < 95.0
    assert result.coverage.percent == pytest.approx(exact, abs=1.0)
