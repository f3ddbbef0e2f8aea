"""A flight that comes back by its messages is judged as it was flown; others by what their files say."""

import json
import re

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.cli.main import main
from swarm_mj.errors import InteropError, SwarmError
from swarm_mj.observation.coverage import percent_text
from swarm_mj.scenarios.loading import parse_overrides
from swarm_mj.smallbody.shape_io import save_shape
from tests.interop.conftest import CHEAP


@pytest.fixture(scope="module")
def messages(flown, tmp_path_factory):
    folder = tmp_path_factory.mktemp("messages") / "out"
    flown.export(folder, ["oem", "aem"])
    return folder


def files(folder, kind, names=("sc1", "sc2")):
    return [folder / kind / f"{name}.{kind}" for name in names]


def test_a_run_that_is_exported_and_observed_again_has_the_same_cells_at_the_same_times(flown, messages):
    seen = sm.observe(files(messages, "oem"), files(messages, "aem"), scenario=flown.scenario)
    for ours, theirs in ((flown.coverage, seen.coverage), (flown.passage, seen.passage)):
        assert np.array_equal(ours.first_seen_by_s, theirs.first_seen_by_s, equal_nan=True)
    assert flown.coverage.percent == seen.coverage.percent > 0
    assert seen.result.images == flown.result.images and seen.notes == []


def test_so_has_one_whose_arrival_alone_counts_and_whose_relay_takes_no_pictures(tmp_path):
    scenario = sm.load(
        "eros-quick",
        parse_overrides(
            [
                *CHEAP,
                "observation.criterion=arrival",
                "behavior.name=dedicated_communications",
                "camera.half_angle_deg=6",
            ]
        ),
    )
    flown = sm.fly(scenario)
    assert flown.plan.n == 3
    flown.export(tmp_path / "out", ["oem", "aem"], ccsds=3)
    seen = sm.observe(files(tmp_path / "out", "oem"), files(tmp_path / "out", "aem"), scenario=scenario)
    assert 0 < seen.coverage.percent == flown.coverage.percent < 100
    assert np.array_equal(seen.coverage.first_seen_by_s, flown.coverage.first_seen_by_s[:2], equal_nan=True)


def test_pictures_between_the_samples_of_a_file_are_taken_from_where_the_path_is(flown, messages, tmp_path):
    """Every third sample of the path is as good as all of them: gravity is smooth, and Hermite's polynomial follows it."""
    thin = []
    for path in files(messages, "oem"):
        head, data = path.read_text().split("META_STOP\n\n")
        rows = data.strip().splitlines()
        assert len(rows) % 3 == 1
        thin.append(tmp_path / path.name)
        thin[-1].write_text(f"{head}META_STOP\n\n" + "\n".join(rows[::3]) + "\n")
    seen = sm.observe(thin, files(messages, "aem"), scenario=flown.scenario)
    assert np.abs(seen.flight.telemetry["r_BN_N"].values - flown.telemetry["r_BN_N"].values).max() < 1e-3
    assert np.array_equal(seen.coverage.seen_by, flown.coverage.seen_by)


def test_without_attitudes_the_cameras_look_where_it_is_said(flown, messages):
    from swarm_mj.spacecraft.attitude.mrp import dcm

    for pointing, aim_A in (("nadir", np.zeros(3)), ("target", flown.plan.region.centroid_A.mean(axis=0))):
        seen = sm.observe(files(messages, "oem"), scenario=flown.scenario, pointing=pointing)
        telemetry = seen.flight.telemetry
        k = 120
        C_AN = flown.plan.environment.C_AN(telemetry["time"].values[k])
        line = C_AN.T @ aim_A - telemetry["r_BN_N"].values[k, 0]
        C_BN = dcm(telemetry["sigma_BN"].values[k, 0])
        assert C_BN[2] @ line == pytest.approx(np.linalg.norm(line), rel=1e-14)
        assert abs(C_BN[0] @ flown.plan.environment.spin_N) < 1e-18 and np.linalg.det(C_BN) == pytest.approx(1)
        words = {"nadir": "the body's centre (nadir)", "target": "the target's centre"}[pointing]
        assert f"no attitudes were given: the cameras point at {words}" in seen.notes[0]
        assert seen.coverage.percent > 0


def test_for_a_body_alone_the_files_tell_when(messages, flown):
    seen = sm.observe(
        files(messages, "oem"), files(messages, "aem"), body="eros", overrides={"camera.resolution_px": 128}
    )
    scenario = seen.scenario
    assert (scenario.epoch, scenario.duration_s) == ("2018-01-01T03:15:00", 1200.0)
    r = np.linalg.norm(flown.telemetry["r_BN_N"].values[::2, 0], axis=1)  # every 10 s
    assert scenario.design.time_of_flight_s == 10.0 * np.argmin(r)
    assert seen.result.images == 2 * 121 and seen.passage.percent >= flown.passage.percent
    assert list(seen.cells.columns) == list(flown.cells.columns.drop("arrives_s"))  # nothing was sent
    assert "SC1, SC2 past 433 Eros" in repr(seen)


def part_of(messages, path, samples):
    """The file of the first spacecraft's path, with some of its samples alone."""
    head, data = files(messages, "oem")[0].read_text().split("META_STOP\n\n")
    rows = data.strip().splitlines()[samples]
    for key, row in (("START_TIME", rows[0]), ("STOP_TIME", rows[-1])):
        head = re.sub(f"\n{key} = .*", f"\n{key} = {row.split()[0]}", head)
    path.write_text(f"{head}META_STOP\n\n" + "\n".join(rows) + "\n")
    return path


def test_what_lies_outside_a_files_time_is_no_picture_and_is_said(messages, flown, tmp_path):
    path = part_of(messages, tmp_path / "half.oem", slice(61))
    aem = files(messages, "aem", ["sc1"])
    seen = sm.observe(path, aem, scenario=flown.scenario)
    assert seen.result.images == 6  # at 0, 60, ... 300 s; the arrival is at 600 s
    assert seen.notes == ["SC1: nothing is known of 0:15:00 of the flight, in which it takes no pictures"]
    with pytest.raises(
        InteropError, match="criterion = arrival: at the arrival, 2018-01-01T03:25:00.000 TDB, none of .*half.oem"
    ):
        sm.observe(path, aem, scenario=flown.scenario, overrides={"observation.criterion": "arrival"})
    with pytest.raises(
        InteropError, match="half.oem: covers 2018-01-01T03:15.* and nothing of the flight, 2019-.*; set epoch"
    ):
        sm.observe(path, aem, scenario=flown.scenario, overrides={"epoch": "2019-01-01T00:00:00"})


@pytest.mark.parametrize(("samples", "arrives_s"), [(slice(61), 300), (slice(61, None), 200)])
def test_who_flew_elsewhere_is_to_be_known_at_its_own_arrival(messages, flown, tmp_path, samples, arrives_s):
    """The second one, of which no file is given, arrives at 600 s; the first one is known until 300 s or from 305 s on."""
    path, aem = part_of(messages, tmp_path / "part.oem", samples), files(messages, "aem", ["sc1"])
    observers = [{"time_of_flight_s": arrives_s}, {}]
    asked = {"observation.criterion": "arrival", "design.observers": observers}
    if arrives_s == 300:
        seen = sm.observe(path, aem, scenario=flown.scenario, overrides=asked).coverage
        assert seen.percent > 0.0 and np.nanmax(seen.first_seen_by_s) == 300.0
    else:
        with pytest.raises(InteropError, match="at the arrival, 2018-01-01T03:18:20.000 TDB, none of .*part.oem"):
            sm.observe(path, aem, scenario=flown.scenario, overrides=asked)


def test_files_that_do_not_belong_together_are_refused(messages, flown, tmp_path):
    oem, aem = files(messages, "oem"), files(messages, "aem")
    with pytest.raises(
        InteropError, match=r"OBJECT_NAME = SC2, but .* is of SC1; give the AEM in the order of the OEM"
    ):
        sm.observe(oem, aem[::-1], body="eros")
    with pytest.raises(InteropError, match="2 OEM and 1 AEM: give one AEM for each OEM"):
        sm.observe(oem, aem[:1], body="eros")
    with pytest.raises(InteropError, match="CENTER_NAME = EROS, but the body is BENNU"):
        sm.observe(oem, body="bennu")
    with pytest.raises(
        InteropError,
        match="body = 'erso' is no packaged body: did you mean 'eros'.*YAML file.*--scenario FILE",
    ):
        sm.observe(oem, body="erso")
    with pytest.raises(InteropError, match="give either a scenario .* or a body"):
        sm.observe(oem, body="eros", scenario=flown.scenario)
    with pytest.raises(InteropError, match="pointing = 'up': must be nadir or target"):
        sm.observe(oem, body="eros", pointing="up")
    metres = tmp_path / "small.oem"  # positions a thousand times too small: in Mm, say
    metres.write_text(re.sub(r"e([+-]\d\d)", lambda m: f"e{int(m[1]) - 3:+03d}", oem[0].read_text()))
    with pytest.raises(InteropError, match=r"small.oem: lies inside .* at 2018-01-01T03:.*lengths are km"):
        sm.observe(metres, body="eros")
    with pytest.raises(
        InteropError, match=r"3 spacecraft are given \(.*\), and the scenario has 2 observers.*dedicated relay"
    ):
        sm.observe([*oem, oem[0]], scenario=flown.scenario)
    with pytest.raises(SwarmError):
        sm.observe(oem, body="eros", overrides={"camera.half_angle_deg": 900})


def test_the_command_says_what_was_seen_and_writes_it(messages, tmp_path, capsys):
    oem, aem = files(messages, "oem"), files(messages, "aem")
    command = ["observe", "--oem", str(oem[0]), "--oem", str(oem[1]), "--aem", str(aem[0]), "--aem", str(aem[1])]
    out = tmp_path / "judged"
    assert (
        main(
            [
                *command,
                "--body",
                "eros",
                "--camera",
                "9",
                "--set",
                "camera.resolution_px=64",
                "--out",
                str(out),
                "--quiet",
            ]
        )
        == 0
    )
    said = capsys.readouterr().out
    summary = json.loads((out / "observation.json").read_text())
    assert f"{percent_text(summary['coverage_percent'])} in the passage" in said and "SC2:" in said
    with np.load(out / "coverage.npz") as arrays:
        assert 100 * arrays["area"][arrays["seen"]].sum() / arrays["area"].sum() == pytest.approx(
            summary["coverage_percent"]
        )
    assert main([*command, "--scenario", "none.yaml"]) == 2
    assert "none.yaml" in capsys.readouterr().err


@pytest.fixture(scope="module")
def kernels(exported):
    """The exported kernels in a kernels-kernel that holds from anywhere."""
    names = [
        exported / "spice" / name for name in ("leapseconds.tls", "swarm.tsc", "swarm.tf", "swarm.bsp", "swarm.bc")
    ]
    return names


def test_spk_and_ck_of_a_run_give_the_same_cells_as_it_saw(flown, kernels):
    seen = sm.observe(kernels=kernels, scenario=flown.scenario)
    assert seen.flight.names == ("SWARM_SC1", "SWARM_SC2") and seen.notes == []
    for ours, theirs in ((flown.coverage, seen.coverage), (flown.passage, seen.passage)):
        assert np.array_equal(ours.first_seen_by_s, theirs.first_seen_by_s, equal_nan=True)
    one = sm.observe(
        kernels=kernels, spacecraft="SWARM_SC2/SWARM_SC2_BODY", body="eros", overrides={"camera.half_angle_deg": 9}
    )
    assert one.flight.names == ("SWARM_SC2",) and one.coverage.percent > 0.0
    turned = sm.observe(kernels=[name for name in kernels if name.suffix != ".bc"], scenario=flown.scenario)
    assert "no attitudes were given: the cameras point at the body's centre" in turned.notes[0]


def test_kernels_that_do_not_say_enough_are_refused(flown, kernels):
    for given, words in (
        ({"kernels": kernels, "spacecraft": "HAYABUSA2"}, r"spacecraft = HAYABUSA2: is in none of the SPKs"),
        ({"kernels": kernels, "spacecraft": "NOBODY"}, r"spacecraft = NOBODY: SPICE says .*the FK that names it"),
        ({"kernels": kernels, "spacecraft": "SWARM_SC1/J2000"}, r"frame J2000: is in none of the CKs"),
        ({"kernels": kernels[:3]}, r"no SPK with a spacecraft"),
        ({}, r"give either OEM \(--oem\) or SPICE kernels \(--kernels\)"),
    ):
        with pytest.raises(InteropError, match=words):
            sm.observe(**given, scenario=flown.scenario)


def test_a_body_of_ones_own_is_a_shape_file_or_a_yaml_file(flown, messages, kernels, tmp_path):
    save_shape(flown.plan.shape, tmp_path / "own.obj")
    own = {name: getattr(flown.scenario.body, name).model_dump() for name in ("rotation", "orbit")}
    body = {
        "name": "433 Eros",
        "shape": "own.obj",
        "gravity": {"model": "point_mass", "parameters": {"gm": 4.5e5}},
        **own,
    }
    (tmp_path / "own.yaml").write_text(json.dumps(body))
    packaged = sm.observe(files(messages, "oem"), body="eros")
    by_yaml = sm.observe(files(messages, "oem"), body=str(tmp_path / "own.yaml"))
    assert (
        by_yaml.coverage.percent == pytest.approx(packaged.coverage.percent, abs=0.5)
        and packaged.coverage.percent > 1.0
    )
    eros = {"ephemerides.body": "2000433"}
    by_shape = sm.observe(
        kernels=kernels,
        body=str(tmp_path / "own.obj"),
        overrides=eros | {f"body.{key}": value for key, value in own.items()},
    )
    assert by_shape.coverage.percent > 1.0
    with pytest.raises(
        InteropError, match=r"own.obj: says nothing of its orbit; give body.orbit in a YAML file or by --set"
    ):
        sm.observe(kernels=kernels, body=str(tmp_path / "own.obj"), overrides=eros | {"body.rotation": own["rotation"]})
