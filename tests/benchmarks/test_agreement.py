"""The page of agreement: converters and differences, the page by its numbers, programs where they are installed."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import assoc_legendre_p

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))  # the benchmarks are no part of the installed package

from benchmarks.agreement import coefficients, comparison, in_scipy  # noqa: E402
from benchmarks.agreement.flights import MISSIONS, fly, utc_of  # noqa: E402
from benchmarks.agreement.job import Job  # noqa: E402
from benchmarks.agreement.page import page  # noqa: E402
from benchmarks.agreement.programs import PROGRAMS, ask, installed  # noqa: E402
from swarm_mj.io.times import instant  # noqa: E402
from swarm_mj.smallbody.gravity import SphericalHarmonics  # noqa: E402
from swarm_mj.smallbody.rotation import Rotation  # noqa: E402

FIELD = SphericalHarmonics.eros_degree_2()
TERMS = coefficients.terms(FIELD.c, FIELD.s)
PAGE = ROOT / "docs" / "results" / "agreement.md"
NUMBERS = PAGE.with_suffix(".json")


@pytest.mark.parametrize("text", ["2015-06-30T23:59:59", "2015-07-01T00:00:00.5", "2018-03-01T00:00:30"])
def test_instants_are_told_in_utc_on_both_sides_of_a_leap_second(text):
    assert utc_of(instant(text, "UTC")).isoformat()[:19] == text[:19]


@pytest.mark.parametrize(("n", "m"), [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2), (5, 3), (8, 8)])
def test_fully_normalised_harmonics_have_a_mean_square_of_one_over_the_sphere(n, m):
    x, weights = np.polynomial.legendre.leggauss(40)
    legendre = assoc_legendre_p(n, m, x)[0]
    over_longitude = 1.0 if m == 0 else 0.5
    mean = 0.5 * np.sum(weights * (coefficients.factor(n, m) * legendre) ** 2) * over_longitude
    assert mean == pytest.approx(1.0, rel=1e-13)


def test_coefficients_without_normalisation_are_those_of_the_textbooks():
    """C20 of Eros: sqrt(5) times the normalised one; C22: sqrt(5/12)."""
    plain = {(n, m): (c, s) for n, m, c, s in coefficients.unnormalised(TERMS)}
    assert plain[2, 0][0] == pytest.approx(5**0.5 * -5.24618393097e-2, rel=1e-15)
    assert plain[2, 2] == pytest.approx(
        ((5 / 12) ** 0.5 * 8.23993879858e-2, (5 / 12) ** 0.5 * -2.81095559016e-2), rel=1e-15
    )
    assert plain[2, 1][1] == pytest.approx((5 / 3) ** 0.5 * -1.40003806164e-7, rel=1e-15)


def test_basilisk_gets_a_row_for_every_degree():
    c, s = coefficients.rows(TERMS)
    assert [len(row) for row in c] == [len(row) for row in s] == [1, 2, 3]
    assert c[0] == [1.0] and c[2][2] == FIELD.c[2, 2] and s[2][1] == FIELD.s[2, 1]


def test_a_file_of_icgem_holds_every_digit():
    text = coefficients.icgem("FIELD", FIELD.gm, FIELD.reference_radius, TERMS)
    head, _, data = text.partition("end_of_head ==============\n")
    assert dict(line.split() for line in head.splitlines())["norm"] == "fully_normalized"
    rows = [line.split() for line in data.splitlines()]
    assert [(int(n), int(m), float(c), float(s)) for _, n, m, c, s in rows] == TERMS


def test_the_arbiter_has_the_field_and_the_rotation_of_the_body():
    job = Job(Path("."), {"gm": FIELD.gm, "radius": FIELD.reference_radius, "terms": TERMS}, {})
    r_A = np.random.default_rng(1).normal(size=(50, 3)) * 2e4
    ours = FIELD.acceleration(r_A)
    assert np.abs(in_scipy.attraction(job, r_A) - ours).max() < 1e-12 * np.abs(ours).max()
    given, t = Rotation(), 5000.0
    angles = (*np.radians([given.pole_ra_deg, given.pole_dec_deg]), given.phase(2451545.0), given.spin_rate)
    C_EN = np.array(in_scipy.turn(1, -np.radians(23.43928)))
    assert np.abs(in_scipy.body_attitude(angles, t) @ C_EN - given.C_AN(2451545.0, t)).max() < 1e-14


def test_the_closed_form_refuses_a_field_that_it_does_not_have():
    with pytest.raises(ValueError, match="degrees 0 and 2 only"):
        in_scipy.degree_2_form([*TERMS, (3, 0, 1e-3, 0.0)])


def test_differences_are_angles_and_distances_however_small():
    small = 1e-9
    assert comparison.angle(in_scipy.turn(3, 0.7 + small), in_scipy.turn(3, 0.7)) == pytest.approx(small, rel=1e-6)
    assert comparison.angle(in_scipy.turn(1, 2.0), np.eye(3)) == pytest.approx(2.0)
    assert comparison.distance(np.array([[0.0, 0, 0], [3, 4, 0]]), np.zeros((2, 3))) == 5.0
    assert comparison.direction(np.array([[1.0, small, 0]]), np.array([[2.0, 0, 0]])) == pytest.approx(small)


#: Coarse and short of spacecraft, so that it takes seconds.
CHANGES = {"telemetry.interval_s": 0.5, "physics.timestep_s": 0.1, "duration_s": 600}
SMALL = replace(MISSIONS["eros-config1"], scenario="eros-quick", changes=CHANGES)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    pytest.importorskip("spiceypy")
    folder = tmp_path_factory.mktemp("job")
    return fly(SMALL, folder, {"observation.interval_s": 600, "camera.resolution_px": 128}), folder


#: What is agreed on, for each program: quantity and the most.
MOST = {
    "scipy": {
        "path": 1e-4,
        "rotation exported": 1e-3,
        "rotation published": 0.25,
        "attitude": 1.0,
        "wheel speed": 1e-3,
    },
    "orekit": {
        "path": 1e-4,
        "rotation exported": 1e-3,
        "file OEM 2.0": 1e-3,
        "file AEM 1.0": 1.0,
        "UTC of the epoch": 2.0,
    },
    "brahe": {"path": 1e-4, "rotation exported": 1e-3, "file OEM 2.0": 1e-3, "file AEM 2.0": 1.0},
    "spiceypy": {
        "rotation exported": 1e-3,
        "file SPK": 1e-3,
        "file CK": 1.0,
        "file DSK, vertices": 1e-9,
        "ecliptic": 1e-9,
    },
    "basilisk": {"path": 1e-4, "rotation exported": 1e-3, "attitude": 1.0, "wheel speed": 1e-3},
}


@pytest.mark.slow
@pytest.mark.parametrize("program", list(MOST))
def test_a_program_that_is_installed_agrees(flown, program):
    if installed(program) is None:
        pytest.skip(f"{program} is not installed")
    rows = comparison.compare(flown[0], {program: ask(program, flown[1])})
    found = {row["quantity"]: row["difference"] for row in rows}
    for quantity, most in MOST[program].items():
        assert found[quantity] <= most, quantity
    if program == "scipy":
        assert found["rotation published"] > 0.15  # the obliquity's rounding, 0.04 arcsec


def test_a_program_that_fails_is_told_by_its_own_words(tmp_path):
    with pytest.raises(RuntimeError, match="scipy failed: (.|\n)*job.json|asked.npz"):
        ask("scipy", tmp_path)


def test_the_page_is_made_of_the_numbers_beside_it():
    assert page(json.loads(NUMBERS.read_text(encoding="utf-8"))) == PAGE.read_text(encoding="utf-8")


def test_without_programs_the_page_says_how_to_install_them():
    results = json.loads(NUMBERS.read_text(encoding="utf-8"))
    results["versions"] = dict.fromkeys(PROGRAMS)
    results["failed"], results["causes"] = {}, {}
    results.pop("brahe_spk", None)
    for flight in results["flights"].values():
        flight["rows"] = []
    text = page(results)
    for program in PROGRAMS.values():
        assert f"| {program.title} | not installed here: `{program.install}` |" in text


def test_what_is_not_installed_is_found_out_and_is_no_error():
    code = (
        "import importlib.util as u; find = u.find_spec\n"
        "u.find_spec = lambda name, *a: None if name in ('orekit_jcc', 'Basilisk') else find(name, *a)\n"
        "from benchmarks.agreement.programs import installed\n"
        "print(installed('orekit'), installed('basilisk'), installed('scipy') is not None)"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True, env={**os.environ}
    )
    assert ended.stdout.split() == ["None", "None", "True"]


def test_rounding_alone_is_what_long_sums_of_equal_steps_lose():
    """A straight flight at 2.5e9 m whose every step is rounded up by the same 3/8 of the spacing of numbers there."""
    from types import SimpleNamespace

    n, spacing = 1000, 2.0**-21
    v = np.array([2.0**10 + 0.625 * spacing, 0.0, 0.0]) * 2.0
    times = 0.5 * np.arange(n + 1.0)
    states_N = np.concatenate([2.5e9 + np.outer(times, v), np.tile(v, (n + 1, 1))], axis=1)[:, None]
    scenario = SimpleNamespace(physics=SimpleNamespace(timestep_s=0.5))
    states = SimpleNamespace(plan=SimpleNamespace(scenario=scenario), times=times, states_N=states_N)
    error = comparison.rounding(SimpleNamespace(states=states, stride=1))
    assert error.shape == (n + 1, 1, 3)
    assert np.allclose(error[:, 0, 0], 0.375 * spacing * np.arange(n + 1), rtol=0, atol=spacing)
