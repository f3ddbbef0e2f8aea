"""The mothership by an OEM or an SPK: its state at the epoch, at a sample and between two, and what is refused."""

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.errors import InteropError, ScenarioError
from swarm_mj.flight.environment import environment_from, load_body_shape
from swarm_mj.flight.mothership import mothership_state
from swarm_mj.smallbody.naif import BodyName
from swarm_mj.tracks.ccsds_in import read_oem
from swarm_mj.tracks.interpolation import interpolate, slopes

#: Of the exported flight, whose first spacecraft stands for a mothership: at a sample, and between two of them.
INSTANTS = {"2018-01-01T03:20:00": 300.0, "2018-01-01T03:20:02": 302.0}


def by(way, epoch="2018-01-01T03:20:00"):
    scenario = sm.load({"name": "by-file", "epoch": epoch, "mothership": {"ephemeris": way}})
    return mothership_state(scenario, environment_from(scenario, load_body_shape(scenario.body)))


@pytest.mark.parametrize("epoch", INSTANTS)
def test_an_oem_and_an_spk_give_the_state_that_was_flown(flown, exported, epoch):
    pytest.importorskip("spiceypy")
    by_oem = by({"oem": str(exported / "oem" / "sc1.oem")}, epoch)
    by_spk = by({"spk": str(exported / "spice" / "swarm.bsp"), "target": "-900001"}, epoch)
    for mine, theirs, most in zip(by_oem, by_spk, (1e-3, 1e-6), strict=True):
        assert np.abs(mine - theirs).max() < most
    if INSTANTS[epoch] % 5.0 == 0.0:
        now = flown.telemetry.sel(time=INSTANTS[epoch]).isel(spacecraft=0)
        assert np.abs(by_oem[0] - now["r_BN_N"].values).max() < 1e-6
        assert np.abs(by_oem[1] - now["v_BN_N"].values).max() < 1e-9


def test_slopes_are_the_derivatives_of_what_is_interpolated():
    t, times = np.arange(8.0) * 1.3, np.linspace(0.4, 8.7, 23)
    values = np.stack([np.sin(t), t**3], axis=1)
    rates = np.stack([np.cos(t), 3.0 * t**2], axis=1)
    for keys in ({"degree": 7, "rates": rates}, {"degree": 5}):
        step = 1e-5
        ahead, behind = (interpolate(t, values, times + s, **keys) for s in (step, -step))
        assert slopes(t, values, times, **keys) == pytest.approx((ahead - behind) / (2 * step), rel=1e-6, abs=1e-7)
    # A cubic is its own Hermite polynomial.
    assert slopes(t, values, times, degree=7, rates=rates)[:, 1] == pytest.approx(3.0 * times**2, rel=1e-11)


def test_velocities_of_a_linear_track_are_the_files(exported, tmp_path):
    text = (exported / "oem" / "sc1.oem").read_text("utf-8")
    path = tmp_path / "linear.oem"
    path.write_text(text.replace("INTERPOLATION = HERMITE", "INTERPOLATION = LINEAR"))
    track = read_oem(path, BodyName.of("433 Eros"))
    at = [track.state_at(track.first + ns) for ns in (0, 2_500_000_000, 5_000_000_000)]
    assert at[1][1] == pytest.approx((at[0][1] + at[2][1]) / 2.0, rel=1e-9)
    assert track.state_at(track.last + 1) is None


def test_a_file_is_found_beside_the_scenario(exported, tmp_path):
    (tmp_path / "m.oem").write_text((exported / "oem" / "sc1.oem").read_text("utf-8"))
    file = tmp_path / "s.yaml"
    file.write_text("name: s\nmothership: {ephemeris: {oem: m.oem}}\n")
    assert sm.load(file).mothership.ephemeris.oem == str(tmp_path / "m.oem")


def test_a_file_that_does_not_tell_is_refused_in_one_line(exported, tmp_path):
    oem, spk = str(exported / "oem" / "sc1.oem"), str(exported / "spice" / "swarm.bsp")
    (tmp_path / "none.oem").write_text("nothing")
    for error, words, way, epoch in (
        (InteropError, ["ephemeris.oem = ", "covers 2018-01-01T03:15", "epoch"], {"oem": oem}, "2019-01-01T00:00:00"),
        (InteropError, ["ephemeris.oem: ", "line 1"], {"oem": str(tmp_path / "none.oem")}, "2018-01-01T03:20:00"),
        (InteropError, ["ephemeris.oem: ", "no such file"], {"oem": str(tmp_path / "no")}, "2018-01-01T03:20:00"),
        (ScenarioError, ["ephemeris.spk", "no such file"], {"spk": "/no.bsp", "target": "X"}, "2018-01-01T03:20:00"),
        (ScenarioError, ["-77", "ephemeris.spk"], {"spk": spk, "target": "-77"}, "2018-01-01T03:20:00"),
        (ScenarioError, ["NOBODY", "ephemeris.spk"], {"spk": spk, "target": "NOBODY"}, "2018-01-01T03:20:00"),
        (ScenarioError, ["-900001", "ephemeris.spk"], {"spk": spk, "target": "-900001"}, "2019-01-01T00:00:00"),
    ):
        with pytest.raises(error) as refusal:
            by(way, epoch)
        text = str(refusal.value)
        assert "\n" not in text and all(word in text for word in words), text
