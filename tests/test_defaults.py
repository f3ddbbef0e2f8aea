"""Defaults that stand in two places agree, and the default epoch has the geometry it was chosen for."""

import numpy as np
import pytest

from swarm_mj.flight.plan import make_plan
from swarm_mj.observation.capture import incidence
from swarm_mj.scenarios.loading import load_scenario, packaged_names
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_body import HeliocentricOrbit, RotationState
from swarm_mj.smallbody.ephemeris import DEFAULT_EPOCH, EROS_ORBIT
from swarm_mj.smallbody.occultation import segments_blocked
from swarm_mj.smallbody.rotation import Rotation, sub_point


def test_schema_and_library_share_the_default_epoch_orbit_and_rotation():
    assert Scenario.model_fields["epoch"].default == DEFAULT_EPOCH
    # eros-approach has its arrival at the same instant, but begins earlier.
    names = [name for name in packaged_names() if name.startswith("eros-") and name != "eros-approach"]
    assert all(load_scenario(name).epoch == DEFAULT_EPOCH for name in names)
    orbit = HeliocentricOrbit()
    assert all(getattr(EROS_ORBIT, key) == pytest.approx(getattr(orbit, key)) for key in HeliocentricOrbit.model_fields)
    assert Rotation(**RotationState().model_dump()) == Rotation()


def test_at_the_default_epoch_the_target_is_sunlit_during_the_imaging(config_flights):
    plan, telemetry = config_flights["eros-config1"]
    environment, region = plan.environment, plan.region
    observing = telemetry["time"].values[(telemetry["mode"].values[:, :5] == 0).any(axis=1)]
    start = region.centroid_A + 1.0 * region.normal_A
    for t in np.linspace(0.0, observing.max(), 12):
        sun_A = environment.C_AN(t) @ environment.sun.at(t)
        sun_A /= np.linalg.norm(sun_A)
        assert (region.normal_A @ sun_A).min() > np.cos(np.radians(60))
        mesh = region.mesh
        assert not segments_blocked(start, start + 60e3 * sun_A, mesh.vertices, mesh.faces, mesh.max_radius).any()
    latitude, _ = sub_point(environment.sun.position, environment.C_AN(0.0))
    assert latitude == pytest.approx(12.4, abs=0.2)


@pytest.mark.parametrize("name", ["eros-config1", "eros-config2"])
def test_at_the_default_epoch_earth_is_never_occulted(config_flights, name):
    plan, telemetry = config_flights[name]
    for k in range(0, telemetry.sizes["time"], 30):
        t = float(telemetry["time"][k])
        C_AN = plan.environment.C_AN(t)
        earth_A = C_AN @ plan.environment.earth.at(t)
        r_A = telemetry["r_BN_N"].values[k] @ C_AN.T
        horizon = r_A + 1e5 * earth_A / np.linalg.norm(earth_A)
        assert not segments_blocked(r_A, horizon, plan.shape.vertices, plan.shape.faces, plan.shape.max_radius).any()


def test_at_the_epoch_of_the_elements_the_sun_would_only_graze_the_target():
    plan = make_plan(load_scenario("eros-quick", {"epoch": "2019-05-02T00:00:00"}))
    C_AN, sun = plan.environment.C_AN(0.0), plan.environment.sun.position
    latitude, _ = sub_point(sun, C_AN)
    angle = np.degrees(incidence(plan.region, C_AN @ sun))
    assert abs(latitude) > 80
    assert np.average(angle, weights=plan.region.area) > 75
    assert 0.1 < plan.region.area[angle > 90].sum() / plan.region.total_area < 0.3
