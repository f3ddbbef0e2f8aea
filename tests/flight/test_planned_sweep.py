"""Planned sweeps: what they fly is what was planned, storage and links bind them, and narrow cameras map bodies unlike Eros."""

from functools import cache

import pytest

import swarm_mj as sm
from swarm_mj.errors import MissionError
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.flight.planned_sweep import PlannedSweep, picture_bit
from swarm_mj.records.summary import summarise
from swarm_mj.scenarios.loading import parse_overrides
from tests.sample_missions.flights import MESHES, SIX_HOURS, mission

SWEEP = "behavior={name: planned_sweep, parameters: {time_limit_s: 1, tolerance: 0.1}}"


@cache
def plan(name="eros-observe", *changes):
    scenario = sm.load(name).changed(
        parse_overrides(["observation.observer=horizon", "target.cell_size_m=900", SWEEP, *changes])
    )
    return make_plan(scenario, check_separation=False)


def pictures_of(plan):
    return plan.behavior.for_flight(plan).mission.planned.allocation


@pytest.fixture(scope="module")
def flown():
    made = plan("eros-observe", "target.cell_size_m=600")
    telemetry = simulate(made)
    return made, telemetry, observe_flight(made, telemetry)


def test_a_quiet_flight_takes_its_pictures_as_planned_and_sees_what_they_show(flown):
    made, telemetry, seen = flown
    found = summarise(made, telemetry, seen, {})["picture_plan"]
    assert found["taken"] >= 20 and found["as_planned"] >= 0.95 * found["taken"]
    assert found["planned_percent"] <= found["bound_percent"] + 1e-6
    assert found["gap_percent"] == pytest.approx(
        100 - 100 * found["planned_percent"] / found["bound_percent"], abs=1e-3
    )
    # The square field of view and pictures on the way show more, never less.
    assert 0.99 * found["planned_percent"] <= seen.coverage.percent <= found["bound_percent"]


def test_storage_limits_the_pictures_of_each():
    few = plan("eros-observe", f"data.storage_bit={3 * picture_bit(plan().scenario) + 5}")
    found, free = pictures_of(few), pictures_of(plan())
    assert max(map(len, found.pictures)) == 3 < max(map(len, free.pictures))
    assert found.value < free.value


def test_what_links_carry_limits_the_pictures_of_all():
    sweep = {"time_limit_s": 1, "tolerance": 0.1, "objective": "delivered"}
    soon, late = (
        pictures_of(plan("eros-observe", f"data.horizon_s={end}", f"behavior.parameters={sweep}"))
        for end in (900, 172800)
    )
    assert 0 < sum(map(len, soon.pictures)) < sum(map(len, late.pictures))
    assert soon.value < late.value == pytest.approx(pictures_of(plan()).value)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("dumbbell", ("camera.half_angle_deg=3", "observation.interval_s=60")),
        ("dumbbell", ("camera.half_angle_deg=3", "observation.interval_s=60", "body.shape=RING")),
        ("fast_flyby", (*SIX_HOURS, "camera.half_angle_deg=1")),
    ],
    ids=["dumb-bell", "torus", "fast flyby"],
)
def test_narrow_cameras_sweep_bodies_unlike_eros(name, changes, tmp_path):
    MESHES["ring.obj"]().export(tmp_path / "ring.obj")
    changes = [change.replace("RING", str(tmp_path / "ring.obj")) for change in changes]
    made = make_plan(
        mission(name, tmp_path, ("observation.criterion=passage", SWEEP, *changes)), check_separation=False
    )
    found = pictures_of(made)
    assert 0.0 < found.value <= found.bound <= made.region.total_area * (1 + 1e-9)
    assert any(found.pictures)


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({"objective": "best"}, "objective = 'best'"),
        ({"tolerance": 0.0}, "tolerance = 0"),
        ({"time_limit_s": -1.0}, "time"),
    ],
)
def test_impossible_sweeps_are_refused(wrong, word):
    with pytest.raises(MissionError, match=word):
        PlannedSweep(2, 1e4, **wrong)
