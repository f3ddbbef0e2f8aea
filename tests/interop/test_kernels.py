"""SPICE's own routines, with the exported kernels alone, say what the telemetry says."""

from dataclasses import replace

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.errors import InteropError
from swarm_mj.interop.kernels import cameras, rotation_constants
from swarm_mj.io import times
from swarm_mj.io.spice import furnished
from swarm_mj.smallbody.naif import BodyName
from swarm_mj.smallbody.rotation import sub_point
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.spacecraft.mounting import true_mount

pytest.importorskip("spiceypy")
MICRORADIAN = 1e-6
FIXED = "SWARM_EROS_FIXED"
CAMERA = {
    "camera": {
        "detector_px": [2048, 1088],
        "detector_ifov_rad": 78e-6,
        "resolution_px": 2048,
        "boresight_B": [1.0, 0.4, -0.3],
        "misalignment_deg": [0.0, 0.5, 2.0],
    }
}


def angle(C):
    """By how much a rotation turns [rad], shape (..., 3, 3), exact for small ones."""
    skew = C - np.swapaxes(C, -1, -2)
    axis = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)
    return np.arctan2(np.linalg.norm(axis, axis=-1), np.trace(C, axis1=-2, axis2=-1) - 1.0)


def test_positions_come_back_to_a_millimetre_and_velocities_with_them(spice, states):
    for j in range(states.plan.n):
        got = [spice.spkezr(f"SWARM_SC{j + 1}", et, "ECLIPJ2000", "NONE", "EROS")[0] for et in states.et]
        assert np.abs(1e3 * np.array(got) - states.states_N[:, j]).max() < 1e-3


def test_between_samples_the_path_keeps_the_law_of_gravity(spice, states):
    """Second differences of SPICE's positions half-way are the acceleration that the field gives there."""
    middle, h = states.et[10] + 2.5, 1.0
    r = [1e3 * spice.spkpos("SWARM_SC1", middle + k * h, "ECLIPJ2000", "NONE", "EROS")[0] for k in (-1, 0, 1)]
    environment = states.plan.environment
    expected = environment.acceleration_N(states.times[10] + 2.5, r[1][None])[0]
    assert np.abs((r[0] - 2 * r[1] + r[2]) / h**2 - expected).max() < 2e-2 * np.linalg.norm(expected)


def test_attitudes_come_back_to_a_microradian_with_their_rates(spice, states):
    C_BN, omega_B = dcm(states.telemetry["sigma_BN"].values), states.telemetry["omega_BN_B"].values
    for j in range(states.plan.n):
        name = f"SWARM_SC{j + 1}_BODY"
        got = np.array([spice.pxform("ECLIPJ2000", name, et) for et in states.et])
        assert angle(got @ np.swapaxes(C_BN[:, j], 1, 2)).max() < MICRORADIAN
        k = 7
        rotation, omega_N = spice.xf2rav(spice.sxform("ECLIPJ2000", name, states.et[k]))
        assert np.abs(rotation @ omega_N - omega_B[k, j]).max() < 1e-9


def test_the_cameras_boresight_is_the_telemetrys(spice, states):
    """+z of B in N: the third row of C_BN, and not its third column."""
    _, frame, boresight, *_ = spice.getfov(-900001001, 10)
    k = len(states.et) // 2
    line = spice.pxform(frame, "ECLIPJ2000", states.et[k]) @ boresight
    C_BN = dcm(states.telemetry["sigma_BN"].values[k, 0])
    assert np.linalg.norm(np.cross(line, C_BN[2])) < 2e-8 < np.linalg.norm(line - C_BN[:, 2]) and line @ C_BN[2] > 0.0


def test_the_field_of_view_is_a_square_of_the_cameras_half_angle(spice, states):
    shape, _, _, count, corners = spice.getfov(-900001001, 10)
    tangents = corners[:, :2] / corners[:, 2:]
    assert shape == "RECTANGLE" and count == 4
    assert np.abs(np.abs(tangents) - states.camera.tan_half_angle).max() < 1e-12


def test_a_rectangle_that_is_mounted_askew_has_the_corners_of_its_own_pictures(spice, states, tmp_path):
    """By SPICE's field of view, against points that the camera's model holds, turned into B by its mount."""
    mounted = sm.load({**states.plan.scenario.model_dump(exclude_unset=True), **CAMERA})
    (tmp_path / "mounted.ti").write_text(cameras(replace(states, plan=replace(states.plan, scenario=mounted))))
    spice.furnsh(str(tmp_path / "mounted.ti"))
    try:
        _, _, boresight, _, corners = spice.getfov(-900001001, 10)
        assert list(spice.gipool("INS-900001001_PIXEL_SAMPLES", 0, 1)) == [2048]
    finally:
        spice.unload(str(tmp_path / "mounted.ti"))
    C_CB = true_mount(mounted.camera)
    x, y, z = C_CB @ corners.T
    assert C_CB @ boresight == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    assert np.abs(x / z) == pytest.approx(1024 * 78e-6) and np.abs(y / z) == pytest.approx(544 * 78e-6)
    assert np.sign(x) @ np.sign(y) == 0.0 and abs(np.sign(x).sum()) == 0.0


def test_the_body_turns_as_in_the_flight(spice, states):
    """PCK against the flight's C_AN; a pole, a sign or a transposition that is wrong is wrong by radians."""
    for et, t in zip(states.et[::20], states.times[::20], strict=True):
        assert angle(spice.pxform("ECLIPJ2000", FIXED, et) @ states.plan.environment.C_AN(t).T) < 1e-9


@pytest.mark.parametrize("pole", [(0.0, 90.0), (10.0, -90.0), (200.0, -60.0), (85.0, 12.0)])
def test_constants_of_rotation_hold_for_any_pole_and_sense(states, tmp_path, pole):
    from dataclasses import replace

    from swarm_mj.interop.kernels import body_constants, frames
    from swarm_mj.smallbody.rotation import Rotation

    rotation = Rotation(pole_ra_deg=pole[0], pole_dec_deg=pole[1], w0_deg=33.0, w_rate_deg_per_day=-700.0)
    environment = replace(states.plan.environment, C_PN=rotation.C_PN, phase0=2.5, spin_rate=rotation.spin_rate)
    other = replace(states, plan=replace(states.plan, environment=environment))
    paths = [tmp_path / "a.tpc", tmp_path / "a.tf"]
    for path, write in zip(paths, (body_constants, frames), strict=True):
        path.write_text(write(other))
    with furnished(paths, "kernels") as spice:
        for t in (0.0, 5e4):
            got = spice.pxform("ECLIPJ2000", FIXED, other.epoch / 1e9 + t)
            assert angle(got @ environment.C_AN(t).T) < 2e-9
    # Right ascension and declination are the scenario's but for the rounding of the obliquity.
    if abs(pole[1]) < 89.0:
        ra, dec, _ = rotation_constants(other)
        assert abs(dec - pole[1]) < 2e-5 and abs((ra - pole[0] + 180) % 360 - 180) * np.cos(np.radians(dec)) < 2e-5


def test_the_point_below_a_spacecraft_is_ours(spice, states):
    for k in (60, 120, 200):  # it starts below the south pole, where longitudes mean nothing
        r_N = states.states_N[k, 1, :3]
        latitude, longitude = sub_point(r_N / np.linalg.norm(r_N), states.plan.environment.C_AN(states.times[k]))
        point, _, _ = spice.subpnt("INTERCEPT/ELLIPSOID", "EROS", states.et[k], FIXED, "NONE", "SWARM_SC2")
        _, lon, lat = spice.reclat(point)
        assert np.degrees(lat) == pytest.approx(latitude, abs=1e-6)
        assert np.degrees(lon) % 360 == pytest.approx(longitude, abs=1e-6)


def test_where_the_boresight_meets_the_surface_is_the_same_by_dsk_and_by_hand(spice, states):
    """The whole chain at once: path, attitude, field of view, rotation and shape."""
    k = states.arrival
    point, *_ = spice.sincpt(
        "DSK/UNPRIORITIZED", "EROS", states.et[k], FIXED, "NONE", "SWARM_SC1", "SWARM_SC1_BODY", [0, 0, 1]
    )
    C_AN, C_BN = states.plan.environment.C_AN(states.times[k]), dcm(states.telemetry["sigma_BN"].values[k, 0])
    shape = states.plan.shape
    origin, line = C_AN @ states.states_N[k, 0, :3], C_AN @ C_BN[2]
    a, b, c = np.moveaxis(shape.vertices[shape.faces], 1, 0)
    # origin + s line = a + u (b - a) + v (c - a)
    s, u, v = np.linalg.solve(
        np.stack([np.broadcast_to(-line, a.shape), b - a, c - a], axis=2), (origin - a)[..., None]
    ).T[0]
    nearest = s[(u >= 0) & (v >= 0) & (u + v <= 1) & (s > 0)].min()
    assert np.linalg.norm(1e3 * point - (origin + nearest * line)) < 1e-3


def test_the_shape_comes_back_to_the_vertex(spice, states, exported):
    handle = spice.dasopr(str(exported / "spice" / "body.bds"))
    found = spice.dlabfs(handle)
    segment = found[0] if isinstance(found, tuple) else found
    n_vertices, n_plates = spice.dskz02(handle, segment)
    vertices = 1e3 * spice.dskv02(handle, segment, 1, n_vertices)
    plates = spice.dskp02(handle, segment, 1, n_plates) - 1
    spice.dascls(handle)
    assert np.abs(vertices - states.plan.shape.vertices).max() < 1e-9
    assert np.array_equal(plates, states.plan.shape.faces)


def test_sun_and_earth_stand_where_the_flight_had_them(spice, states):
    environment = states.plan.environment
    for name, body in (("SUN", environment.sun), ("EARTH", environment.earth)):
        for k in (0, -1):
            got = 1e3 * spice.spkpos(name, states.et[k], "ECLIPJ2000", "NONE", "EROS")[0]
            assert np.linalg.norm(got - body.at(states.times[k])) < 1e-3


def test_texts_in_utc_are_what_astropy_and_our_leap_seconds_kernel_say(spice):
    time = pytest.importorskip("astropy.time")
    for text in ("1972-01-01T00:00:00", "1999-07-01T12:00:00.25", "2016-12-31T23:59:60.5", "2018-01-01T03:13:50.816"):
        ours = times.instant(text, "UTC") / 1e9
        tdb = time.Time(text, scale="utc").tdb
        theirs = ((tdb.jd1 - 2_451_545.0) + tdb.jd2) * 86_400.0
        assert ours == pytest.approx(theirs, abs=5e-5)
        assert spice.str2et(text.replace("T", " ")) == pytest.approx(ours, abs=1e-6)
    assert times.instant("2018-001T03:15:00", "TDB") == times.epoch_of("2018-01-01T03:15:00")


def test_time_systems_differ_by_what_they_should():
    text, second = "2018-01-01T03:15:00.000000001", 10**9
    tdb = {system: times.instant(text, system) for system in times.SYSTEMS}
    assert abs(tdb["TT"] - tdb["TDB"]) < 2_000_000
    assert abs(tdb["TAI"] - tdb["TT"] - 32_184_000_000) <= 100
    assert abs(tdb["UTC"] - tdb["TAI"] - 37 * second) <= 100
    assert abs(tdb["GPS"] - tdb["TAI"] - 19 * second) <= 100
    assert times.text_of(tdb["TDB"]) == text


@pytest.mark.parametrize("text", ["2018-13-01T00:00:00", "2018-02-30T00:00:00", "2018-366T00:00:00", "2018-01-01T24:00:00",
                                  "2018-01-01T23:59:60", "2018-01-01", "1 Jan 2018", "²018-01-01T00:00:00", ""])  # fmt: skip
def test_what_is_no_date_is_refused(text):
    with pytest.raises(ValueError):
        times.instant(text, "UTC")


def test_no_kernel_is_left_in_the_pool_and_the_callers_come_back(exported, monkeypatch):
    import spiceypy

    monkeypatch.chdir(exported / "spice")
    spiceypy.kclear()
    spiceypy.furnsh("swarm.tm")
    before = spiceypy.ktotal("ALL")
    with furnished([exported / "spice" / "body.tpc"], "kernels") as spice:
        assert spice.ktotal("ALL") == 1
    assert spiceypy.ktotal("ALL") == before
    spiceypy.kclear()
    for content in (None, "no kernel\n", "\\begindata\nA = = 1\n"):
        path = exported.parent / "broken.tpc"
        if content is not None:
            path.write_text(content)
        with pytest.raises(
            InteropError, match=r"^kernels = .*broken.tpc: .*; give [^\n]*$|^kernels = .*; give another[^\n]*$"
        ):
            with furnished([exported / "spice" / "body.tpc", path], "kernels"):
                pass
        assert spiceypy.ktotal("ALL") == 0 and not spiceypy.failed()
        assert not spiceypy.expool("BODY2000433_POLE_RA")


def test_a_file_that_a_meta_kernel_names_is_missed_in_its_name(tmp_path):
    (tmp_path / "meta.tm").write_text("KPL/MK\n\\begindata\nKERNELS_TO_LOAD = ('absent.tpc')\n")
    words = "^kernels = .*meta.tm names absent.tpc: .*is looked for from the current folder"
    with pytest.raises(InteropError, match=words), furnished([tmp_path / "meta.tm"], "kernels"):
        pass


@pytest.mark.parametrize(
    "name", ["x" * 1000, "21 Lutetia, seen from far away", "1234567 (2019 AB) provisional", "ß" * 40, "-"]
)
def test_no_name_of_a_body_is_too_long_for_the_variables_of_spice(name):
    import spiceypy

    spiceypy.pipool(f"FRAME_{BodyName.of(name).frame}", [1])
    spiceypy.kclear()


@pytest.mark.parametrize(
    ("name", "code", "short"),
    [("433 Eros", 2000433, "EROS"), ("101955 Bennu", 2101955, "BENNU"), ("21 Lutetia", 2000021, "LUTETIA"),
     ("25143 Itokawa", 2025143, "ITOKAWA"), ("Pebble", 9999999, "PEBBLE"), ("1234567 New", 21234567, "NEW")],
)  # fmt: skip
def test_bodies_have_the_numbers_that_naif_gave_them(name, code, short):
    import spiceypy

    body = BodyName.of(name)
    assert (body.code, body.name) == (code, short)
    if short in ("EROS", "BENNU", "LUTETIA", "ITOKAWA"):
        assert spiceypy.bodn2c(short) == code
