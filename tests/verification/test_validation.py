"""The checks pass on the program as it is, each fails on a program with a fault, and the command reports both."""

import json
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from swarm_mj.errors import OutputError, SwarmError
from swarm_mj.flight import plan as planning
from swarm_mj.mission import links as program_links
from swarm_mj.observation import horizon, raycast
from swarm_mj.observation.gl_faces import OpenGlFaces
from swarm_mj.observation.raster import CompiledFaces
from swarm_mj.observation.raycast import RayTracer
from swarm_mj.simulator import batch, flight_setup
from swarm_mj.smallbody.ephemeris import Ephemeris
from swarm_mj.smallbody.gravity import PointMass, Polyhedron, SphericalHarmonics
from swarm_mj.smallbody.gravity.compiled import compiled_field
from swarm_mj.smallbody.rotation import Rotation
from swarm_mj.spacecraft.attitude import mrp
from swarm_mj.spacecraft.control import MrpSlidingMode
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.verification import attitude, coverage, ephemerides, flights, orbits, runner, target
from swarm_mj.verification.experiment import Bench, Check, Experiment, NotRun
from swarm_mj.verification.runner import EXPERIMENTS, choose, run_experiments, run_validation

WITH_OPENGL = ("coverage-footprint-faceid", "coverage-pixels", "coverage-observers", "coverage-polygons-faceid")


@pytest.fixture(scope="module")
def checks():
    """Every check, run once on the program as it is, the day in orbit for a quarter of it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(orbits, "DAY_S", 21_600.0)
        return {check.name: check for check in run_experiments(EXPERIMENTS)}


@pytest.mark.parametrize("name", [e.name for e in EXPERIMENTS if e.name not in WITH_OPENGL])
def test_the_program_passes_the_check(checks, name):
    if checks[name].passed is None:
        pytest.skip(checks[name].note)
    assert checks[name].passed, checks[name]


def test_a_quarter_of_the_day_in_orbit_leaves_room_for_the_rest(checks):
    """An error that grows with the square of time has a sixteenth of what the day allows."""
    assert checks["orbit-day"].measured < checks["orbit-day"].tolerance / 1000.0
    assert checks["orbit-jacobi"].measured < checks["orbit-jacobi"].tolerance / 4.0


@pytest.mark.gl
@pytest.mark.parametrize("name", WITH_OPENGL)
def test_the_program_passes_the_check_of_its_pictures(checks, name):
    assert checks[name].passed, checks[name]


def scaled(owner, name, factor):
    """A method whose first or only result is wrong by a factor."""
    right = getattr(owner, name)

    def wrong(self, *arguments):
        result = right(self, *arguments)
        return (factor * result[0], *result[1:]) if isinstance(result, tuple) else factor * result

    return owner, name, wrong


def leaking(field):
    """A field with a tiny spring, which has a divergence."""
    right = field.acceleration
    return field, "acceleration", lambda self, r_A: right(self, r_A) + 1e-13 * r_A


def with_model(change):
    """A simulation on another model than the one stated."""
    return flights, "build_model", change(flights.build_model)


def made_of(**properties):
    def change(build):
        return lambda n, **keys: build(n, **{**keys, "properties": SpacecraftProperties(**properties)})

    return with_model(change)


def first_order(build):
    def euler(*arguments, **keys):
        model = build(*arguments, **keys)
        model.mjmodel.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        return model

    return euler


def late_arrival():
    right = planning.deploy

    def deploy(*arguments, **keys):
        found = right(*arguments, **keys)
        return replace(found, v0_N=found.v0_N + 1e-5)

    return planning, "deploy", deploy


def heavier_wheels():
    """In the world of compiled code, which alone steps by it."""
    right = batch.make_world

    def make_world(*arguments, **keys):
        world = right(*arguments, **keys)
        return world._replace(wheel_inertia=1.001 * world.wheel_inertia)

    return batch, "make_world", make_world


def steeper_law():
    right = MrpSlidingMode._numbers.func
    return MrpSlidingMode, "_numbers", property(lambda self: right(self) * (1.001, 1, 1, 1, 1, 1, 1, 1))


def turned_camera():
    right = raycast.camera_pose
    return raycast, "camera_pose", lambda r_A, C_CA: right(r_A, np.diag([1.0, -1.0, -1.0]) @ C_CA)


def mirrored_picture():
    right = OpenGlFaces._picture_from_mesh
    return OpenGlFaces, "_picture_from_mesh", lambda self, pose: np.diag([1.0, -1.0, 1.0, 1.0]) @ right(self, pose)


def narrower_picture():
    right = OpenGlFaces._picture_from_mesh
    return OpenGlFaces, "_picture_from_mesh", lambda self, pose: np.diag([1.1, 1.1, 1.0, 1.0]) @ right(self, pose)


def mirrored_compiled_picture():
    right = CompiledFaces._picture_from_body
    return CompiledFaces, "_picture_from_body", lambda self, pose: np.diag([1.0, -1.0, 1.0]) @ right(self, pose)


def narrower_compiled_picture():
    right = CompiledFaces._picture_from_body
    return CompiledFaces, "_picture_from_body", lambda self, pose: np.diag([1.1, 1.1, 1.0]) @ right(self, pose)


def wider_maps():
    right = horizon.look_at_all

    def look(maps, r_A, C_CA, optics, radius):
        return right(maps, r_A, C_CA, optics._replace(tan_half_angle=1.1 * optics.tan_half_angle), radius)

    return horizon, "look_at_all", look


def square_cone():
    right = raycast.sampled_fraction

    def sampled_fraction(tracer, region, cells, camera, *rest):
        return right(tracer, region, cells, replace(camera, shape="square"), *rest)

    return raycast, "sampled_fraction", sampled_fraction


def lost_rays():
    right = RayTracer.first_hit

    def first_hit(self, origins, directions):
        hits = right(self, origins, directions)
        hits[::50] = -1
        return hits

    return RayTracer, "first_hit", first_hit


LATE_EARTH = replace(ephemerides.EARTH_ORBIT, perihelion_jd=ephemerides.EARTH_ORBIT.perihelion_jd + 0.05)
WIDE_EARTH = replace(ephemerides.EARTH_ORBIT, semi_major_axis_au=1.0003)
EROS = ephemerides.EROS_ORBIT
LATE_EROS = replace(EROS, perihelion_jd=EROS.perihelion_jd + 3.0)
TURNED_EROS = replace(EROS, node_deg=EROS.node_deg + 1.0)
TILTED_EROS = replace(EROS, inclination_deg=EROS.inclination_deg + 1.0)
LONG_EROS = replace(EROS, eccentricity=EROS.eccentricity + 0.01)
WIDE_EROS = replace(ephemerides.EROS_ORBIT, semi_major_axis_au=1.46)
TURNED = partial(Ephemeris, rotation=Rotation(w0_deg=326.08001))


def repelling(gravity):
    """A compiled field that pushes away."""
    field = compiled_field(gravity)
    return field and field._replace(gm=-field.gm, series=-field.series)


#: What is broken, and the checks that must find it.
FAULTS = {
    "sign of the point mass": (scaled(PointMass, "acceleration", -1.0), ["gravity-point-mass"]),
    "sign of the harmonics": (
        scaled(SphericalHarmonics, "acceleration", -1.0),
        ["gravity-harmonics"],  # flights take the compiled field
    ),
    "sign of the field in flight": ((flight_setup, "compiled_field", repelling), ["orbit-day", "orbit-jacobi"]),
    "size of the polyhedron's field": (
        scaled(Polyhedron, "acceleration", 1.0001),
        ["gravity-polyhedron", "gravity-series", "gravity-polyhedral-gravity", "gravity-poisson-polyhedron"],
    ),
    "divergence of the point mass": (leaking(PointMass), ["gravity-laplace-point-mass"]),
    "divergence of the harmonics": (leaking(SphericalHarmonics), ["gravity-laplace-harmonics"]),
    "divergence of the polyhedron": (leaking(Polyhedron), ["gravity-laplace-polyhedron"]),
    "start velocities": (late_arrival(), ["trajectories-miss"]),
    "transposed matrices": ((attitude, "dcm", lambda sigma: mrp.dcm(-sigma)), ["attitude-matrices"]),
    "sign of the kinematics": ((attitude, "mrp_rate", lambda s, w: mrp.mrp_rate(-s, w)), ["attitude-kinematics"]),
    "inertia of the wheels": (
        made_of(wheel_spin_inertia=2.39e-5),
        ["attitude-momentum", "attitude-gyrostat"],
    ),
    "inertia of the body": (made_of(size=(0.1, 0.1, 0.3401)), ["attitude-energy", "attitude-momentum"]),
    "integrator": (with_model(first_order), ["attitude-order"]),
    "wheels of the kernel": (heavier_wheels(), ["attitude-step"]),
    "slope of the law": (steeper_law(), ["control-sliding-mode"]),
    "phase of Earth": ((ephemerides, "EARTH_ORBIT", LATE_EARTH), ["ephemeris-seasons", "ephemeris-astropy"]),
    "size of Earth's orbit": ((ephemerides, "EARTH_ORBIT", WIDE_EARTH), ["ephemeris-perihelion"]),
    "Eros late": ((ephemerides, "EROS_ORBIT", LATE_EROS), ["ephemeris-eros-place", "ephemeris-eros-distance"]),
    "Eros's node": ((ephemerides, "EROS_ORBIT", TURNED_EROS), ["ephemeris-eros-place", "ephemeris-eros-distance"]),
    "Eros's inclination": ((ephemerides, "EROS_ORBIT", TILTED_EROS), ["ephemeris-eros-place"]),
    "Eros's eccentricity": (
        (ephemerides, "EROS_ORBIT", LONG_EROS),
        ["ephemeris-eros-place", "ephemeris-eros-distance"],
    ),
    "size of Eros's orbit": ((ephemerides, "EROS_ORBIT", WIDE_EROS), ["ephemeris-eros-period"]),
    "velocities": (
        (
            ephemerides,
            "position_velocity",
            lambda orbit, jd: np.array([1.0, 1.0001])[:, None] * ephemerides_state(orbit, jd),
        ),
        ["ephemeris-velocity"],
    ),
    "prime meridian": ((ephemerides, "Ephemeris", TURNED), ["ephemeris-rotation"]),
    "sides of the pyramid": (
        (target, "build_target", partial(target.build_target, edges="side")),
        ["target-area", "target-visiting-points"],
    ),
    "camera that looks back": (turned_camera(), ["coverage-polygons-rays"]),
    "field of view": (square_cone(), ["coverage-footprint-rays"]),
    "lost rays": (lost_rays(), ["coverage-limb"]),
    "transparent body": (
        (
            program_links,
            "closed_links",
            lambda beams, body, *rest, right=program_links.closed_links: right(
                beams, body._replace(faces=body.faces[:0]), *rest
            ),
        ),
        ["links-geometry"],
    ),
    "field of view of the maps": (wider_maps(), ["coverage-polygons-horizon"]),
    "mirrored drawing": (mirrored_compiled_picture(), ["coverage-pixels-raster", "coverage-polygons-raster"]),
    "scale of the drawing": (narrower_compiled_picture(), ["coverage-footprint-raster"]),
}
FAULTS_OF_PICTURES = {
    "mirrored buffer": (mirrored_picture(), ["coverage-pixels", "coverage-observers", "coverage-polygons-faceid"]),
    "scale of the buffer": (narrower_picture(), ["coverage-footprint-faceid"]),
}


def ephemerides_state(orbit, jd, right=ephemerides.position_velocity):
    return np.array(right(orbit, jd))


def assert_found(fault, names, monkeypatch, tmp_path):
    for name in names:
        needed = next(e.package for e in EXPERIMENTS if e.name == name)
        if needed:
            pytest.importorskip(needed)
    monkeypatch.setattr(*fault)
    monkeypatch.setattr(orbits, "DAY_S", 7200.0)  # a fault that shows in two hours shows in a day
    status = run_validation(names, json_path=tmp_path / "checks.json", quiet=True)
    found = json.loads((tmp_path / "checks.json").read_text())["checks"]
    assert {check["name"]: check["passed"] for check in found} == dict.fromkeys(names, False)
    assert status == 1


@pytest.mark.parametrize("what", FAULTS)
def test_a_fault_in_the_program_fails_its_checks_and_the_command(what, monkeypatch, tmp_path):
    assert_found(*FAULTS[what], monkeypatch, tmp_path)


@pytest.mark.gl
@pytest.mark.parametrize("what", FAULTS_OF_PICTURES)
def test_a_fault_in_the_pictures_fails_their_checks_and_the_command(what, monkeypatch, tmp_path):
    assert_found(*FAULTS_OF_PICTURES[what], monkeypatch, tmp_path)


def test_every_check_is_known_to_find_a_fault():
    found = [name for _, names in (*FAULTS.values(), *FAULTS_OF_PICTURES.values()) for name in names]
    assert set(found) == {e.name for e in EXPERIMENTS}


def test_links_are_compared_where_each_condition_decides():
    from swarm_mj.verification import links

    closed = []

    def watch(**keys):
        closed.append(program_links.links_closed(**keys))
        return closed[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(links, "links_closed", watch)
        assert links.wrong_links(Bench()) == 0
    assert (closed[0].mean(axis=0) > 0.02).all() and (closed[0].mean(axis=0) < 0.9).all()


def test_the_command_prints_a_table_and_writes_json_and_markdown(tmp_path, capsys):
    json_path, page = tmp_path / "new" / "checks.json", tmp_path / "validation.md"
    assert run_validation(["ephemeris", "target-area"], json_path, page, quiet=True) == 0
    printed = capsys.readouterr().out
    names = [e.name for e in EXPERIMENTS if e.group == "ephemeris"] + ["target-area"]
    content = json.loads(json_path.read_text())
    assert [check["name"] for check in content["checks"]] == names
    assert content["versions"]["mujoco"] == mujoco.__version__
    rows = [line.split(" | ") for line in page.read_text().splitlines() if line.startswith("| `")]
    assert [row[0].strip("| `") for row in rows] == names
    assert all(len(row) == 6 for row in rows)
    for check in content["checks"]:
        assert check["name"] in printed
        assert check["measured"] <= check["tolerance"]
    assert f"{len(names)} passed, 0 failed, 0 not run" in printed


def test_names_and_groups_choose_checks_in_the_order_of_the_table():
    everything = [e.name for e in EXPERIMENTS]
    assert len(set(everything)) == len(everything)
    assert [e.name for e in choose([])] == everything
    assert [e.name for e in choose(["orbit", "gravity-series"])] == ["gravity-series", "orbit-day", "orbit-jacobi"]


def test_an_unknown_name_is_refused_with_all_names():
    with pytest.raises(SwarmError, match="--only orbt: no such check; did you mean orbit") as error:
        run_validation(["orbit-day", "orbt"])
    assert all(experiment.name in str(error.value) for experiment in EXPERIMENTS)


def experiment(measure=lambda bench: 1.0, **keys):
    given = {"name": "x-y", "what": "a", "reference": "b", "tolerance": 2.0, "unit": "m", "measure": measure, **keys}
    return Experiment(**given)


def test_a_missing_package_is_named_and_does_not_fail(monkeypatch, capsys):
    monkeypatch.setattr(runner, "choose", lambda only: [experiment(package="no_such_package")])
    assert run_validation(quiet=True) == 0
    assert "0 passed, 0 failed, 1 not run" in capsys.readouterr().out
    assert (
        experiment(package="no_such_package").run(Bench()).note
        == "not run: package no_such_package is not installed; the extra dev brings it"
    )


def test_without_opengl_the_checks_of_pictures_are_not_run(monkeypatch):
    monkeypatch.setattr(coverage, "gl_available", lambda: (False, "libEGL.so.1 is missing"))
    outcomes = [e.run(Bench()) for e in choose(WITH_OPENGL)]
    assert [check.passed for check in outcomes] == [None] * len(WITH_OPENGL)
    assert all("libEGL.so.1 is missing" in check.note for check in outcomes)


def fail(error):
    def measure(bench):
        raise error

    return measure


@pytest.mark.parametrize(
    ("measure", "passed", "note"),
    [
        (lambda bench: 2.0, True, ""),
        (lambda bench: 2.1, False, ""),
        (lambda bench: np.nan, False, "measured nan"),
        (fail(ValueError("singular")), False, "ValueError: singular"),
        (fail(SwarmError("the flight diverged")), False, "SwarmError: the flight diverged"),
        (fail(NotRun("no device")), None, "not run: no device"),
    ],
)
def test_a_measurement_passes_fails_or_is_not_run(measure, passed, note):
    check = experiment(measure).run(Bench())
    assert (check.passed, check.note) == (passed, note)


@pytest.mark.parametrize("order", [3, 4, 5])
def test_the_check_of_the_order_passes_the_fourth_alone(order, monkeypatch):
    """Errors c h^p (1 + d h) with the d that flights have, some 1 / s."""
    monkeypatch.setattr(attitude, "fly", lambda *given, timestep, **keys: timestep)
    monkeypatch.setattr(attitude, "attitude_error", lambda step: 1e-4 * step**order * (1.0 + 2.0 * step))
    (check,) = run_experiments(choose(["attitude-order"]))
    assert check.passed is (order == 4)


def test_what_checks_share_is_made_once_in_a_validation_and_anew_in_the_next():
    made = []

    def make(bench):
        made.append(bench)
        return SimpleNamespace()

    bench = Bench()
    assert bench.once(make) is bench.once(make)
    assert Bench().once(make) is not bench.once(make)
    assert len(made) == 2


def test_an_outcome_cannot_be_changed():
    with pytest.raises(AttributeError):
        experiment().run(Bench()).passed = True
    assert isinstance(experiment().run(Bench()), Check)


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="checks.json: cannot be written"):
        run_validation(["target-area"], json_path=tmp_path / "file" / "checks.json", quiet=True)
