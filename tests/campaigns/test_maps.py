"""Horizon maps are made where several runs share them; where each would serve one run, face-ID buffers take their place."""

import pytest

from swarm_mj.campaigns.flying import Flyer
from swarm_mj.campaigns.loading import load_campaign, restore
from swarm_mj.campaigns.runner import run_campaign

from .conftest import ONE

MAPPED = ONE + "set: {{observation.observer: horizon, telemetry.interval_s: 10, design.visiting_points: [12, 20]}}\n"
LATITUDE = "parameters: {target.latitude_deg: {distribution: uniform, low: -57, high: -56}}"


def observer(path):
    resolved = load_campaign(path)
    return resolved.bases["one"].observation.observer, resolved.without_maps


@pytest.mark.parametrize(
    "more",
    [
        LATITUDE,
        "parameters: {target: {distribution: choice, values: [{latitude_deg: -56}]}, "
        "target.half_angle_deg: {distribution: uniform, low: 20, high: 21}}",
        "parameters: {dispersions.target_m: {distribution: uniform, low: 10, high: 100}}",
    ],
)
def test_where_the_cells_of_every_run_differ_no_maps_are_made(write, more):
    assert observer(write(MAPPED, more=more)) == ("raster", ("one",))


def test_a_target_dispersed_by_the_seed_alone_counts_too(write):
    text = MAPPED.replace("[12, 20]", "[12, 20], dispersions.target_m: 100")
    assert observer(write(text)) == ("raster", ("one",))


@pytest.mark.parametrize(
    ("more", "runs"),
    [
        ("", 4),
        (LATITUDE, 1),
        ("parameters: {mothership.position_A_m.2: {distribution: normal, mean: -30000, std: 100}}", 8),
        ("parameters: {target.latitude_deg: {distribution: choice, values: [-56, -57]}}", 40),
        # The camera decides how finely faces may be cut, but here they are fine enough for every angle that is drawn.
        ("parameters: {camera.half_angle_deg: {distribution: uniform, low: 15, high: 16}}", 8),
        (f"{LATITUDE[:-1]}, observation.observer: {{distribution: choice, values: [horizon, raycast]}}}}", 8),
    ],
    ids=["nothing drawn", "one run", "cells alike", "two targets", "camera", "observer drawn"],
)
def test_where_runs_share_their_maps_or_draw_their_observer_it_stays(write, more, runs):
    assert observer(write(MAPPED, more=more, runs=runs)) == ("horizon", ())


def test_the_replacement_leaves_no_maps_and_is_said(write, tmp_path, monkeypatch):
    monkeypatch.setenv("SWARM_MJ_CACHE", str(tmp_path / "cache"))
    resolved = load_campaign(write(MAPPED, runs=2, more=LATITUDE))
    with pytest.warns(
        UserWarning, match="one: the target's cells differ from run to run.*observation.observer: raster"
    ):
        summary = run_campaign(resolved, tmp_path / "out", workers=1, figures=False).summary
    assert summary["scenarios"]["one"]["observer"] == "raster"
    assert summary["failed"] == 0
    assert not (tmp_path / "cache" / "horizons").exists()


def test_workers_fly_what_was_decided_when_the_file_was_read(write):
    resolved = load_campaign(write(MAPPED, runs=2, more=LATITUDE))
    there = Flyer(restore(resolved.dumps()))
    assert there.scenario(there.sample.trial(0)).observation.observer == "raster"
