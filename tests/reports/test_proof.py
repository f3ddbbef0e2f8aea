"""A design's proof stands in the report of what it was made for, and is withdrawn for anything else."""

from dataclasses import replace

import numpy as np

from swarm_mj.api.flight import fly
from swarm_mj.records.design_files import design_differences, made_for
from swarm_mj.records.run_record import read_run
from swarm_mj.reports.page import report_html
from swarm_mj.scenarios.loading import load_scenario, parse_overrides


def test_the_proof_is_shown_with_its_design_and_withdrawn_for_another_camera(tmp_path):
    changes = [
        "design.reference=eros-visit",
        "design.visiting_points=[10, 16, 23, 46, 47]",
        "camera.half_angle_deg=4.1",
    ]
    common = [
        "camera.resolution_px=128",
        "observation.interval_s=600",
        "telemetry.interval_s=10",
        "physics.timestep_s=0.5",
    ]
    scenario = load_scenario("eros-config1", parse_overrides([*changes, *common]))
    fly(scenario, out=tmp_path / "fits", figures=False, report=False)
    fits = report_html([read_run(tmp_path / "fits")])
    assert "Proven: fewer than 5 observers cannot see 100 %" in fits
    assert "does not hold" not in fits
    run = read_run(tmp_path / "fits")
    stopped = {**run.design, "proof": {**run.design["proof"], "status": "interrupted"}}
    text = report_html([replace(run, design=stopped)])
    assert "Not proven to be the fewest that see 100 %" in text and "the design was interrupted." in text
    assert "best so far" in text and "exact solver</" not in text
    wider = run.scenario.model_copy(update={"camera": run.scenario.camera.model_copy(update={"half_angle_deg": 6.0})})
    text = report_html([replace(run, scenario=wider)])
    assert "camera.half_angle_deg: 4.1 there, 6.0 here" in text
    assert "Proven: " not in text
    for changed, words in other_cases(run).items():
        text = report_html([words[0]])
        assert "does not hold" in text and "Proven: " not in text, changed
        assert words[1] in text, changed


def other_cases(run):
    """The run with one thing changed that its design was made for, and what the report must say of it."""

    def with_values(section, **values):
        changed = getattr(run.scenario, section).model_copy(update=values)
        return replace(run, scenario=run.scenario.model_copy(update={section: changed}))

    spin = run.scenario.body.rotation.model_copy(update={"w_rate_deg_per_day": 800.0})
    halved = {name: run.coverage[name] / (2.0 if name.endswith("vertices") else 1) for name in run.coverage}
    halved |= {name: run.coverage[name] for name in ("faces", "body_faces")}
    moved = run.telemetry.assign(r_BN_N=1.01 * run.telemetry["r_BN_N"])
    earlier = {key: value for key, value in run.design.items() if key != "made_for"}
    return {
        "longitude": (with_values("target", longitude_deg=100.0), "target.longitude_deg: 90.0 there, 100.0 here"),
        "altitude": (with_values("design", imaging_altitude_m=13e3), "design.imaging_altitude_m: 14000.0 there, 13000.0"),
        "spin": (with_values("body", rotation=spin), "body.rotation.w_rate_deg_per_day: 1639.389232 there, 800.0 here"),
        "mothership": (with_values("mothership", position_A_m=(0.0, 0.0, -4e4)), "mothership.position_A_m: "),
        "epoch": (
            replace(run, scenario=run.scenario.model_copy(update={"epoch": "2018-01-02T00:00:00"})),
            "epoch: 2018-01-01T03:15:00 there, 2018-01-02T00:00:00 here",
        ),
        "body": (replace(run, coverage=halved), "body.volume: 2,518 km^3 there, 314.8 km^3 here"),
        "points, by a record of an earlier version": (
            replace(run, design=earlier, telemetry=moved), "visiting points lie elsewhere, up to"
        ),
    }  # fmt: skip


def test_a_record_of_an_earlier_version_is_compared_in_what_it_tells(folder):
    run = read_run(folder)
    design = run.scenario.design.visiting_points
    corners_A = np.zeros((1, 3, 3))
    assert design_differences({"visiting_points": list(design)}, run.scenario, corners_A, np.zeros((2, 3))) == []
    handmade = replace(run, design={"visiting_points": list(design)})
    assert "no record of a design with a proof" in report_html([handmade])


def test_only_what_decides_the_candidates_takes_a_proof_away():
    scenario, corners_A = load_scenario("eros-config1"), np.random.default_rng(0).normal(size=(5, 3, 3))
    record = {"made_for": made_for(scenario, corners_A)}

    def differences(*overrides, name="eros-config1"):
        return design_differences(record, load_scenario(name, parse_overrides(overrides)), corners_A)

    assert differences() == [] == differences("link.max_range_m=1e4", "seed=3", "body.name=Eros", name="eros-config2")
    assert differences("body.gravity.model=point_mass", "duration_s=1800") == []
    # Where the Sun stands matters unless light is ignored.
    assert [words.split(":")[0] for words in differences("body.orbit.eccentricity=0.1")] == ["body.orbit.eccentricity"]
    assert differences("body.orbit.eccentricity=0.1", "observation.light=ignored") == []
    passage = differences("body.gravity.model=point_mass", "duration_s=1800", "observation.criterion=passage")
    assert [words.split(":")[0] for words in passage] == ["body.gravity.model", "duration_s"]
    assert len(differences("body.orbit.eccentricity=0.1", "observation.max_incidence_deg=70")) == 1
    assert len(differences("behavior={name: target_sweep, parameters: {surface_radius_m: 7000, dwell_s: 50}}")) == 2
