"""OEM and AEM go out and come back, by our reader and by those of others; what is broken is refused in one line."""

import re

import numpy as np
import pytest

from swarm_mj.errors import InteropError
from swarm_mj.interop.ccsds_out import write_aem, write_oem
from swarm_mj.smallbody.naif import BodyName
from swarm_mj.spacecraft.attitude.mrp import dcm, mrp_from_quaternion, quaternions, steady
from swarm_mj.tracks.ccsds_in import read_aem, read_oem
from swarm_mj.tracks.interpolation import interpolate, slerp
from tests.interop.test_kernels import MICRORADIAN, angle

EROS = BodyName.of("433 Eros")


@pytest.fixture(scope="module", params=[2, 3])
def files(request, states, tmp_path_factory):
    folder = tmp_path_factory.mktemp("messages")
    oem, aem = folder / "sc1.oem", folder / "sc1.aem"
    oem.write_text(write_oem(states, 0, request.param))
    aem.write_text(write_aem(states, 0, request.param))
    return request.param, oem, aem


@pytest.fixture(scope="module")
def old(states, tmp_path_factory):
    folder = tmp_path_factory.mktemp("old")
    (folder / "a.oem").write_text(write_oem(states, 0))
    (folder / "a.aem").write_text(write_aem(states, 0))
    return folder


@pytest.fixture(scope="module")
def C_EN():
    """From N to EME2000, by SPICE."""
    spiceypy = pytest.importorskip("spiceypy")
    return spiceypy.pxform("ECLIPJ2000", "J2000", 0.0)


def C_of_scalar_last(q):
    """The matrix of 504.0-B-2, annex B: from components in frame A to components in frame B."""
    x, y, z, w = np.moveaxis(np.asarray(q), -1, 0)
    rows = (
        (w * w + x * x - y * y - z * z, 2 * (x * y + z * w), 2 * (x * z - y * w)),
        (2 * (x * y - z * w), w * w - x * x + y * y - z * z, 2 * (y * z + x * w)),
        (2 * (x * z + y * w), 2 * (y * z - x * w), w * w - x * x - y * y + z * z),
    )
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def test_our_reader_gets_back_path_and_attitude(files, states):
    _, oem, aem = files
    ns = np.array(states.instants)
    r, known = read_oem(oem, EROS).at(ns)
    assert known.all() and np.abs(r - states.states_N[:, 0, :3]).max() < 1e-6
    q, known = read_aem(aem).at(ns)
    C = dcm(mrp_from_quaternion(q))
    assert known.all() and angle(C @ np.swapaxes(dcm(states.telemetry["sigma_BN"].values[:, 0]), 1, 2)).max() < 1e-12


def test_the_package_oem_reads_it(files, states, C_EN):
    oem = pytest.importorskip("oem")
    message = oem.OrbitEphemerisMessage.open(str(files[1]))
    got = np.array([[*state.position, *state.velocity] for state in message.states]) * 1e3
    expected = np.hstack([states.states_N[:, 0, :3] @ C_EN.T, states.states_N[:, 0, 3:] @ C_EN.T])
    assert np.abs(got - expected).max() < 1e-3
    assert message.segments[0].metadata["CENTER_NAME"] == "EROS"
    assert message.states[1].epoch.scale == "tdb" and str(message.states[1].epoch).startswith("2018-01-01T03:15:05.000")


def test_ccsds_ndm_reads_it(files, states, C_EN):
    ndm_io = pytest.importorskip("ccsds_ndm.ndm_io")
    version, oem, aem = files
    rows = ndm_io.NdmIo().from_path(oem).body.segment[0].data.state_vector
    got = 1e3 * np.array([[row.x.value, row.y.value, row.z.value] for row in rows])
    assert np.abs(got - states.states_N[:, 0, :3] @ C_EN.T).max() < 1e-3
    if version == 3:
        return  # its reader of AEM 2.0 stops at plain quaternions (KeyError); brahe reads those, and no AEM 1.0
    rows = ndm_io.NdmIo().from_path(aem).body.segment[0].data.attitude_state
    q = [row.quaternion_state.quaternion for row in rows]
    C_BE = C_of_scalar_last([[x.q1, x.q2, x.q3, x.qc] for x in q])
    C_BN = dcm(states.telemetry["sigma_BN"].values[:, 0])
    assert angle(C_BE @ C_EN @ np.swapaxes(C_BN, 1, 2)).max() < MICRORADIAN


def test_brahe_reads_it(files, states, C_EN):
    ccsds = pytest.importorskip("brahe.ccsds")
    version, oem, aem = files
    segment = ccsds.OEM.from_file(str(oem)).segments[0]
    got = np.array([state.position for state in segment.states])
    assert np.abs(got - states.states_N[:, 0, :3] @ C_EN.T).max() < 1e-3
    assert (segment.ref_frame, segment.center_name, segment.time_system) == ("EME2000", "EROS", "TDB")
    if version == 2:
        return
    segment = ccsds.AEM.from_file(str(aem)).segments[0]
    q = [state.quaternion for state in segment.states]
    C_BE = C_of_scalar_last([[x.x, x.y, x.z, x.w] for x in q])
    C_BN = dcm(states.telemetry["sigma_BN"].values[:, 0])
    assert angle(C_BE @ C_EN @ np.swapaxes(C_BN, 1, 2)).max() < MICRORADIAN


def test_between_samples_hermite_follows_a_polynomial_of_its_degree_and_lagrange_too():
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 10, 12))
    times = np.concatenate([rng.uniform(t[0], t[-1], 40), t])
    for degree, hermite in ((7, True), (3, True), (5, False), (1, False)):
        p = np.polynomial.Polynomial(rng.normal(size=degree + 1))
        rates = p.deriv()(t)[:, None] if hermite else None
        got = interpolate(t, p(t)[:, None], times, degree=degree, rates=rates)[:, 0]
        assert np.abs(got - p(times)).max() < 1e-8 * np.abs(p(t)).max()
    assert np.array_equal(interpolate(t, t[:, None] ** 2, t, degree=1)[:, 0], t**2)


def test_between_samples_attitude_turns_at_a_constant_rate():
    t, angles = np.array([0.0, 2.0]), np.array([0.3, 1.1])
    q = np.stack([np.cos(angles / 2), 0 * angles, 0 * angles, np.sin(angles / 2)], axis=1)
    for sign in (1.0, -1.0):
        got = slerp(t, q * np.array([[1.0], [sign]]), np.array([0.0, 0.5, 2.0]))
        assert np.abs(2 * np.arctan2(np.abs(got[:, 3]), np.abs(got[:, 0])) - [0.3, 0.5, 1.1]).max() < 1e-14


def test_quaternions_over_two_turns_have_no_jumps_of_sign_and_are_the_same_attitudes():
    """Programs that interpolate component by component would turn the long way where the sign jumps."""
    angles = np.linspace(0.0, 4 * np.pi, 60)
    c, s, o = np.cos(angles), np.sin(angles), np.zeros(60)
    C = np.moveaxis(np.array([[c, s, o], [-s, c, o], [o, o, o + 1]]), 2, 0)
    q = quaternions(C)
    assert np.abs(np.diff(q, axis=0)).max() > 1.0
    q = steady(q)
    assert np.abs(np.diff(q, axis=0)).max() < 0.11
    assert np.abs(C_of_scalar_last(q[:, [1, 2, 3, 0]]) - C).max() < 1e-15


@pytest.mark.parametrize(
    ("system", "frame"), [("UTC", "J2000"), ("TAI", "ICRF"), ("TT", "EME2000"), ("TDB", "ECLIPJ2000")]
)
def test_other_time_systems_and_frames_are_turned_into_ours(states, tmp_path, system, frame):
    """The same instants and states written otherwise, by astropy and SPICE."""
    time, spiceypy = pytest.importorskip("astropy.time"), pytest.importorskip("spiceypy")
    spice_frame = "ECLIPJ2000" if frame == "ECLIPJ2000" else "J2000"
    C = spiceypy.pxform("ECLIPJ2000", spice_frame, 0.0)
    lines = []
    for k in range(6):
        t = time.Time("2018-01-01T03:15:00", scale="tdb", precision=9) + time.TimeDelta(states.times[k], format="sec")
        state = np.concatenate([C @ states.states_N[k, 0, :3], C @ states.states_N[k, 0, 3:]]) / 1e3
        lines.append(f"{getattr(t, system.lower()).isot} {' '.join(map(repr, state.tolist()))}")
    first, last = lines[0].split()[0], lines[-1].split()[0]
    path = tmp_path / "other.oem"
    path.write_text(
        f"CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2018-01-01T00:00:00\nORIGINATOR = X\nMETA_START\nOBJECT_NAME = A\n"
        f"OBJECT_ID = 1\nCENTER_NAME = 433 EROS\nREF_FRAME = {frame}\nTIME_SYSTEM = {system}\nSTART_TIME = {first}\n"
        f"STOP_TIME = {last}\nMETA_STOP\n" + "\n".join(lines) + "\n"
    )
    track = read_oem(path, EROS)
    inside = np.array(states.instants[1:5])
    r, known = track.at(inside)
    assert known.all() and np.abs(r - states.states_N[1:5, 0, :3]).max() < 5e-3  # 50 us of TDB - TT at 60 m/s
    assert "names no INTERPOLATION" in track.notes[0]


SPOILT_OEM = [
    ("CCSDS_OEM_VERS = 2.0", "CCSDS_OEM_VERS = 9.0", "CCSDS_OEM_VERS = 9.0; versions 1.0, 2.0, 3.0 are read"),
    ("CCSDS_OEM_VERS = 2.0", "CCSDS_AEM_VERS = 1.0", "is not CCSDS_OEM_VERS"),
    ("CENTER_NAME = EROS", "CENTER_NAME = EARTH", "CENTER_NAME = EARTH, but the body is EROS, NAIF 2000433; give"),
    ("REF_FRAME = EME2000", "REF_FRAME = TEME", "REF_FRAME = TEME: unknown frame; allowed are EME2000"),
    ("TIME_SYSTEM = TDB", "TIME_SYSTEM = MET", "TIME_SYSTEM = MET; allowed are TDB, TT, TAI, UTC, GPS"),
    ("TIME_SYSTEM = TDB\n", "", "TIME_SYSTEM is missing"),
    ("INTERPOLATION = HERMITE", "INTERPOLATION = SPLINE", "INTERPOLATION = SPLINE; allowed are HERMITE, LAGRANGE, LINEAR"),
    ("INTERPOLATION_DEGREE = 7", "INTERPOLATION_DEGREE = 700", "INTERPOLATION_DEGREE = 700; must be a whole number, 1 to 27"),
    ("INTERPOLATION = HERMITE", "OBJECT_NAME = X", "OBJECT_NAME is given twice"),
    ("META_STOP", "", "is no KEY = value"),
    ("03:20:00.000 ", "03:20:00.000 nan ", "7 numbers after the date, not 6 or 9; the file is cut short"),
    ("2018-01-01T03:20:00.000", "2018-01-01T03:10:00.000", "is not after the line before; sort the lines"),
    ("2018-01-01T03:20:00.000", "2018-01-01T25:20:00.000", "does not exist in TDB; correct the date"),
    ("STOP_TIME = 2018-01-01T03:35", "STOP_TIME = 2018-01-01T05:35", "the data ends elsewhere; the file is cut short"),
]  # fmt: skip


@pytest.mark.parametrize(("there", "instead", "words"), SPOILT_OEM)
def test_a_spoilt_oem_is_refused_with_file_line_and_remedy(old, tmp_path, there, instead, words):
    text = (old / "a.oem").read_text()
    assert there in text
    path = tmp_path / "spoilt.oem"
    path.write_text(text.replace(there, instead, 1))
    with pytest.raises(InteropError, match=r"spoilt\.oem, line \d+: ") as error:
        read_oem(path, EROS)
    assert words in str(error.value) and "\n" not in str(error.value)


SPOILT_AEM = [
    ("ATTITUDE_TYPE = QUATERNION", "ATTITUDE_TYPE = SPIN", "ATTITUDE_TYPE = SPIN; allowed are QUATERNION"),
    ("REF_FRAME_A = EME2000", "REF_FRAME_A = LVLH", "REF_FRAME_A = LVLH: unknown frame"),
    ("REF_FRAME_B = SC_BODY_1", "REF_FRAME_B = STAR_TRACKER", "one must be SC_BODY_1"),
    ("INTERPOLATION_METHOD = LINEAR", "INTERPOLATION_METHOD = HERMITE", "allowed are LINEAR, LAGRANGE"),
    ("DATA_STOP", "", "the file ends inside data, without DATA_STOP; it is cut short"),
    ("03:15:00.000 -", "03:15:00.000 -0.9 -0.9 -0.9 -0.9 #", "8 numbers after the date"),
]


@pytest.mark.parametrize(("there", "instead", "words"), SPOILT_AEM)
def test_a_spoilt_aem_is_refused(old, tmp_path, there, instead, words):
    path = tmp_path / "spoilt.aem"
    text = (old / "a.aem").read_text()
    assert there in text
    path.write_text(text.replace(there, instead, 1))
    with pytest.raises(InteropError) as error:
        read_aem(path)
    assert words in str(error.value) and "\n" not in str(error.value)


def test_the_sense_of_an_aem_may_be_either(old, tmp_path):
    """A2B with a quaternion, B2A with its conjugate, and frames exchanged: one attitude."""
    text = (old / "a.aem").read_text()

    def conjugated(match):
        numbers = [float(x) for x in match[2].split()]
        return f"{match[1]} {' '.join(repr(-x) for x in numbers[:3])} {numbers[3]!r}"

    turned = re.sub(r"^(2018\S+)((?: +\S+){4})$", conjugated, text, flags=re.MULTILINE)
    exchanged = turned.replace("REF_FRAME_A = EME2000", "REF_FRAME_A = SC_BODY_1", 1)
    exchanged = exchanged.replace("REF_FRAME_B = SC_BODY_1", "REF_FRAME_B = EME2000", 1)
    found = []
    for k, content in enumerate((text, turned.replace("A2B", "B2A"), exchanged)):
        (tmp_path / f"{k}.aem").write_text(content)
        found.append(read_aem(tmp_path / f"{k}.aem").stretches[0].values)
    for q in found[1:]:
        assert np.abs(np.abs(np.sum(q * found[0], axis=1)) - 1.0).max() < 1e-15
    (tmp_path / "wrong.aem").write_text(turned)
    wrong = read_aem(tmp_path / "wrong.aem").stretches[0].values
    assert np.abs(np.sum(wrong * found[0], axis=1)).min() < 0.9


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is not CCSDS_OEM_VERS"),
        (b"DAF/SPK \0\0\xff", "is not UTF-8 text"),
        ("CCSDS_OEM_VERS = 2.0".encode("utf-16"), "is not UTF-8 text"),
        (b"<?xml version='1.0'?><oem/>", "is XML; convert it to KVN"),
        (b"CCSDS_OEM_VERS = 2.0\n" + b"x" * 5000, "line 2: is longer than 1000 characters"),
        (b"CCSDS_OEM_VERS = 2.0\n\0", "holds a NUL"),
        (b"CCSDS_OEM_VERS = 2.0\n", "has no META_START"),
        (b"CCSDS_OEM_VERS = 2.0\nMETA_START\n", "the file ends inside metadata"),
        (b"CCSDS_OEM_VERS = 2.0\nMETA_START\nTIME_SYSTEM = TDB\nMETA_STOP\n", "no lines of data"),
    ],
)
def test_what_is_no_oem_is_refused(tmp_path, content, words):
    path = tmp_path / "hostile.oem"
    path.write_bytes(content)
    with pytest.raises(InteropError) as error:
        read_oem(path, EROS)
    assert words in str(error.value) and "hostile.oem" in str(error.value) and "\n" not in str(error.value)


def test_a_file_that_is_missing_too_large_or_a_folder_is_refused(tmp_path, monkeypatch):
    for path in (tmp_path / "none.oem", tmp_path):
        with pytest.raises(InteropError, match="cannot be read .*; give an OEM"):
            read_oem(path, EROS)
    (tmp_path / "large.oem").write_text("CCSDS_OEM_VERS = 2.0\n" * 10)
    monkeypatch.setattr("swarm_mj.tracks.kvn.MAX_BYTES", 100)
    with pytest.raises(InteropError, match="larger than 100 bytes"):
        read_oem(tmp_path / "large.oem", EROS)


def test_of_several_stretches_each_counts_where_it_may_be_used(old, tmp_path):
    """The same file cut in two with a gap: known on both sides of it, unknown inside."""
    text = (old / "a.oem").read_text()
    head, data = text.split("META_STOP\n\n")
    rows = data.strip().splitlines()

    def part(rows):
        meta = re.sub("START_TIME = .*", f"START_TIME = {rows[0].split()[0]}", head[head.index("META_START") :])
        meta = re.sub("STOP_TIME = .*", f"STOP_TIME = {rows[-1].split()[0]}", meta)
        return meta + "META_STOP\n\n" + "\n".join(rows) + "\n\n"

    path = tmp_path / "two.oem"
    path.write_text(head[: head.index("META_START")] + part(rows[:100]) + part(rows[120:]))
    track, whole = read_oem(path, EROS), read_oem(old / "a.oem", EROS)
    ns = np.array([whole.first + k * 2_500_000_000 for k in range(2 * len(rows) - 1)])
    r, known = track.at(ns)
    k = np.arange(len(ns)) / 2
    assert np.array_equal(known, (k <= 99) | (k >= 120))
    assert np.abs(r - whole.at(ns)[0])[known].max() < 1e-3
