"""The spacecraft designer: budgets added up again, and its choice against all choices."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest

from swarm_mj.errors import ScenarioError
from swarm_mj.ideas import components
from swarm_mj.ideas.chain import encounter_of
from swarm_mj.ideas.components import BATTERY_WH, BUS, DETECTORS, EARTH_LINKS, PROPULSION, SIZES, WHEELS
from swarm_mj.ideas.requirement import Requirement, load_requirement
from swarm_mj.ideas.spacecraft import (
    CROSSLINK_SENDS_W,
    IMAGING_H,
    WHEEL_COUNT,
    Encounter,
    Payload,
    Refusal,
    Spacecraft,
    least_observers,
    least_swarm_kg,
    payload_for,
    pictures_in_passage,
    size_spacecraft,
)
from swarm_mj.observation.photometry import radiance_factor, surface_of
from swarm_mj.observation.radiometry import electrons
from swarm_mj.scenarios.constants import AU
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema_imaging import Camera
from swarm_mj.scenarios.schema_photometry import Photometry

SCENARIO = load_scenario("bennu-slow")
SEEN = Encounter(
    area_m2=17_500.0,
    extent_m=200.0,
    speed=5.0,
    altitude_m=1000.0,
    sun_m=0.95 * AU,
    earth_m=0.84 * AU,
    surface=surface_of(Photometry(law="lambert", albedo=0.05)),
    interval_s=10.0,
)


def asked(**changes):
    return Requirement.model_validate({"name": "test", "scenario": "bennu-slow", "resolution_m": 0.2, **changes})


def sized(units=6, detector=1, **changes):
    given = asked(**changes)
    payload = payload_for(given, SEEN, SIZES[units], 1000.0, DETECTORS[detector])
    return given, size_spacecraft(given, SCENARIO, SEEN, SIZES[units], payload)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"delta_v_m_s": 30.0},
        {"delta_v_m_s": 200.0, "limits": {"spacecraft_kg": 14.0}, "contact_h": 3.0},
        {"delta_v_m_s": 500.0, "limits": {"spacecraft_kg": 14.0, "propulsion": ["iodine ion"]}, "listen_share": 0.1},
        {"instruments": {"mass_kg": 0.7, "volume_u": 0.5, "power_w": 6.0}},
    ],
)
def test_budgets_add_up_and_are_kept(changes):
    given, one = sized(**changes)
    assert isinstance(one, Spacecraft)
    m = given.margins
    tank = [row for row in one.rows if row.name == "propellant"]
    parts = [row for row in one.rows if row.name != "propellant"]
    dry = sum(row.mass_kg for row in parts)
    grown = sum(row.mass_kg for row in parts if not (one.propulsion and row.name == one.propulsion.name))
    if one.propulsion is not None:
        # The tank grows with what it holds; the margin is on what is built.
        shell = one.propulsion.tank_share * one.propellant_kg
        assert one.mass_kg == pytest.approx((1.0 + m.mass) * (dry - shell) + shell + one.propellant_kg)
        ratio = one.mass_kg / (one.mass_kg - one.propellant_kg)
        assert 9.80665 * one.propulsion.specific_impulse_s * np.log(ratio) == pytest.approx(given.delta_v_m_s)
        assert tank[0].mass_kg == one.propellant_kg and grown < dry
    else:
        assert one.mass_kg == pytest.approx((1.0 + m.mass) * dry)
    assert one.volume_u == pytest.approx(sum(row.volume_u for row in one.rows) / (1.0 - m.volume))
    assert one.mass_kg <= (given.limits.spacecraft_kg or one.size.limit_kg) and one.volume_u <= one.size.units
    carried = [row[2:5] for row in one.rows if row.name == "other instruments"]
    assert carried == ([tuple(dict(given.instruments).values())] if given.instruments.mass_kg else [])
    # A day: contacts and the rest, by the panels; a contact and a passage with the batteries.
    days = one.propulsion is not None and one.propulsion.continuous
    besides = [row for row in one.rows if row.name in ("reaction control", "panel drive")]
    assert [tuple(row) for row in besides] == [
        (part.name, 1, *part[1:]) for part in (one.propulsion.parts if days else ())
    ]
    bus = sum(part.power_w for part in BUS) + WHEEL_COUNT * one.wheels.power_w + sum(row.power_w for row in besides)
    share = given.contact_h / 24.0
    heard = (1.0 - share) * given.listen_share
    mean = (1.0 + m.power) * (bus + share * one.link.transmits_w + heard * one.link.listens_w)
    assert one.power_w == pytest.approx(mean) and mean <= one.available_w
    assert one.available_w == pytest.approx(
        one.panels * 1361.0 / 0.95**2 * components.PANEL_CELLS_M2 * components.PANEL_EFFICIENCY * m.cells
    )
    stored = m.battery * BATTERY_WH * one.batteries
    assert ((1.0 + m.power) * (bus + one.link.transmits_w) - one.available_w) * given.contact_h <= stored + 1e-9
    passage = bus + one.link.listens_w + one.payload.power_w + given.instruments.power_w + CROSSLINK_SENDS_W
    assert (1.0 + m.power) * passage * IMAGING_H <= stored + 1e-9
    # Mode by mode the same.
    modes = {mode.name.partition(",")[0]: mode for mode in one.modes}
    assert modes["passage"].battery_wh == pytest.approx((1.0 + m.power) * passage * IMAGING_H)
    assert modes["contact with Earth"].power_w == pytest.approx((1.0 + m.power) * (bus + one.link.transmits_w))
    assert sum(mode.hours for name, mode in modes.items() if name not in ("passage", "thrusters")) == pytest.approx(
        24.0
    )
    assert all(mode.battery_wh <= stored + 1e-9 for name, mode in modes.items() if name != "thrusters")
    if one.propulsion is not None:
        assert one.propellant_kg <= one.propulsion.most_kg
        on = given.listen_share if days else 1.0
        burning = bus + on * one.link.listens_w + one.propulsion.power_w
        assert modes["thrusters"].power_w == pytest.approx((1.0 + m.power) * burning)
        impulse = one.propellant_kg * 9.80665 * one.propulsion.specific_impulse_s
        assert modes["thrusters"].hours * 3600.0 * one.propulsion.thrust_n == pytest.approx(impulse)
    cables = next(row for row in one.rows if row.name.startswith("cables"))
    assert cables.mass_kg > 0.0 and one.panels <= one.size.panels


def test_the_choice_is_the_lightest_of_all_choices():
    given, one = sized(delta_v_m_s=40.0, units=6, deliver_within_h=50.0)
    m, size, payload = given.margins, SIZES[6], one.payload
    watt = 1361.0 / 0.95**2 * components.PANEL_CELLS_M2 * components.PANEL_EFFICIENCY * m.cells
    bus, best = sum(part.power_w for part in BUS), np.inf
    for wheel, link, thrust, panels, batteries in itertools.product(
        [w for w in WHEELS if w.momentum_n_m_s >= one.wheels.momentum_n_m_s],
        EARTH_LINKS,
        PROPULSION,
        range(size.panels + 1),
        range(1, 9),
    ):
        load = bus + 3 * wheel.power_w
        kilos = size.structure_kg + payload.mass_kg + sum(part.mass_kg for part in BUS) + thrust.dry_kg
        kilos += (
            3 * wheel.mass_kg
            + link.mass_kg
            + panels * components.PANEL.mass_kg
            + batteries * components.BATTERY.mass_kg
        )
        ratio = np.exp(given.delta_v_m_s / (9.80665 * thrust.specific_impulse_s)) - 1.0
        dry = 1.2 * 1.15 * kilos
        tank = ratio * dry / (1.0 - ratio * thrust.tank_share)
        wet = dry + (1.0 + thrust.tank_share) * tank
        volume = payload.volume_u + sum(part.volume_u for part in BUS) + thrust.volume_u + tank / thrust.density
        volume += (
            3 * wheel.volume_u
            + link.volume_u
            + panels * components.PANEL.volume_u
            + batteries * components.BATTERY.volume_u
        )
        fits = (
            wet <= size.limit_kg
            and volume <= 0.9 * size.units
            and link.least_units <= 6 <= min(link.most_units, thrust.most_units)
        )
        day = 1.1 * (load + link.transmits_w / 3.0 + link.listens_w * 2.0 / 3.0) <= panels * watt
        burning = 1.1 * (load + link.listens_w + thrust.power_w) - panels * watt
        # For days by panels alone; else for an hour with batteries.
        burn = burning <= (0.0 if thrust.continuous else 0.7 * BATTERY_WH * batteries)
        contact = (1.1 * (load + link.transmits_w) - panels * watt) * 8.0 <= 0.7 * BATTERY_WH * batteries
        passage = 1.1 * (load + link.listens_w + payload.power_w + 3.0) <= 0.7 * BATTERY_WH * batteries
        sent = link.radio != "iris_patch"  # 6 dBi send 4 Mpx too slowly
        if fits and day and burn and contact and passage and sent:
            best = min(best, wet)
    assert one.mass_kg == pytest.approx(best, rel=1e-9)


def test_what_cannot_be_built_is_refused_with_its_numbers():
    fine = payload_for(asked(resolution_m=0.01), SEEN, SIZES[3], 2000.0, DETECTORS[1])
    assert isinstance(fine, Refusal) and fine.cause == "diffraction"
    assert fine.needed == pytest.approx(1.22 * 550e-9 * 1.4 * 2000.0 / 0.01) and fine.allowed == 0.09
    dim = payload_for(asked(resolution_m=0.2), SEEN._replace(speed=1e5), SIZES[3], 1000.0, DETECTORS[1])
    assert isinstance(dim, Refusal) and dim.cause == "signal" and dim.allowed < 20.0 == dim.needed
    _, far = sized(deliver_within_h=0.01)
    assert isinstance(far, Refusal) and far.cause == "data" and far.needed > 0.01
    # What 3U do not carry does not count: the patch alone is slower by far.
    _, small = sized(units=3, deliver_within_h=0.01, limits={"units": [3]})
    assert small.needed > 50.0 * far.needed
    _, agile = sized(turn_s=1.0)
    assert isinstance(agile, Refusal) and agile.cause == "wheels"
    given = asked()
    payload = payload_for(given, SEEN, SIZES[6], 1000.0, DETECTORS[1])
    dark = size_spacecraft(given, SCENARIO, SEEN._replace(sun_m=2.0 * AU), SIZES[6], payload)
    assert isinstance(dark, Refusal) and dark.cause == "budgets" and "panels are needed, 6U carry 14" in dark.words


def test_pixels_bound_the_number_of_observers():
    payload = payload_for(asked(), SEEN, SIZES[6], 1000.0, DETECTORS[1])
    assert isinstance(payload, Payload)
    # 14 pictures of 2048^2 pixels of 0.2 m; at 5 m/s, while a pixel samples 0.2 m of any of 200 m.
    wide, once = SEEN._replace(area_m2=2.2e6), SEEN._replace(area_m2=2.2e6, interval_s=0.0)
    assert pictures_in_passage(asked(), wide, payload) == 1 + int((2.0 * 1000.0 * np.sqrt(1.4**2 - 1.0) + 200.0) / 50.0)
    assert least_observers(asked(), once, payload) == 14 and least_observers(asked(), wide, payload) == 1
    # A coarse requirement from nearby gets a finer pixel than it needs, which sees as finely from farther off.
    near = payload_for(asked(resolution_m=2.0), SEEN, SIZES[6], 500.0, DETECTORS[1])
    assert isinstance(near, Payload) and near.pixel_rad < 2.0 / (1.4 * 500.0)
    reach = 2.0 / near.pixel_rad
    expected = 1 + int((2.0 * np.sqrt(reach**2 - 500.0**2) + 200.0) / 50.0)
    assert pictures_in_passage(asked(resolution_m=2.0), SEEN, near) == expected


def test_stereo_takes_twice_the_pictures_and_relays_send_for_all():
    payload = payload_for(asked(), SEEN, SIZES[6], 1000.0, DETECTORS[1])
    once = SEEN._replace(area_m2=2.2e6, interval_s=0.0)
    assert least_observers(asked(quality="resolved"), once, payload) == 14
    assert least_observers(asked(quality="stereo"), once, payload) == 28
    assert least_observers(asked(quality="shape"), once, payload) == 42
    # 28 pictures of 2048^2 bit, 14 for the target and as many again for overlap: by each its one, by a relay all.
    slow = asked().model_copy(update={"deliver_within_h": 1e6})
    own = size_spacecraft(slow, SCENARIO, once, SIZES[6], payload)
    one, two = (size_spacecraft(slow, SCENARIO, once._replace(senders=k), SIZES[6], payload) for k in (1, 2))
    assert one.link == own.link and one.send_h == pytest.approx(28.0 * own.send_h)
    assert two.send_h == pytest.approx(14.0 * own.send_h)
    # Those that only communicate weigh as much.
    assert least_swarm_kg(slow, once._replace(idle=1), one) == pytest.approx(15.0 * one.mass_kg)


def test_batteries_carry_the_body_s_shadow_and_receivers_may_be_off():
    given, one = sized()
    payload = payload_for(given, SEEN, SIZES[6], 1000.0, DETECTORS[1])
    dark = size_spacecraft(given, SCENARIO, SEEN._replace(shadow_s=5.0 * 3600.0), SIZES[6], payload)
    draws = next(mode for mode in dark.modes if mode.name.startswith("passage"))
    assert draws.hours == 5.0 and dark.batteries > one.batteries
    assert draws.battery_wh <= 0.7 * BATTERY_WH * dark.batteries < draws.battery_wh + 0.7 * BATTERY_WH
    _, quiet = sized(listen_share=0.25)
    assert one.power_w - quiet.power_w == pytest.approx(1.1 * 0.75 * 16.0 / 24.0 * one.link.listens_w)


def test_what_may_be_chosen_is_chosen_from():
    _, one = sized(delta_v_m_s=20.0, limits={"propulsion": ["ADN monopropellant"]})
    assert one.propulsion.name == "ADN monopropellant"
    # For an hour batteries help; what burns for days has panels for all of it.
    _, ion = sized(delta_v_m_s=500.0, limits={"propulsion": ["iodine ion"], "spacecraft_kg": 14.0}, listen_share=0.1)
    burning = next(mode for mode in ion.modes if mode.name.startswith("thrusters"))
    assert burning.battery_wh == 0.0 and burning.power_w > 60.0
    # Tanks of a class end somewhere, whatever else there is room for.
    roomy = {"units": [12], "spacecraft_kg": 40.0, "propulsion": ["ADN monopropellant"]}
    _, refused = sized(units=12, delta_v_m_s=300.0, limits=roomy)
    assert isinstance(refused, Refusal)
    by = re.search(
        r"it exceeds the propellant that tanks of this class take by ([0-9.]+) kg at the least", refused.words
    )
    assert 0.05 < float(by[1]) < 3.0
    # A deployer may carry more than the standard's 12 kg.
    _, full = sized(limits={"units": [6], "spacecraft_kg": 14.0, "propulsion": ["cold gas, R236fa"]}, delta_v_m_s=110.0)
    assert 12.0 < full.mass_kg <= 14.0


def test_small_ones_are_built_of_miniature_parts_and_larger_ones_are_not():
    near = {"delta_v_m_s": 150.0, "limits": {"units": [3]}, "contact_h": 1.0, "listen_share": 0.1}
    given, payload = asked(**near), payload_for(asked(**near), SEEN, SIZES[3], 1000.0, DETECTORS[1])
    one = size_spacecraft(given, SCENARIO, SEEN._replace(earth_m=0.1 * AU), SIZES[3], payload)
    assert one.link.radio == "xband_patch" and one.propulsion.name == "ASCENT monopropellant, miniature"
    assert "attitude unit, miniature" in {row.name for row in one.rows} and one.mass_kg < 6.0
    large = size_spacecraft(given, SCENARIO, SEEN._replace(earth_m=0.1 * AU), SIZES[6], payload)
    assert large.link.radio == "iris_patch" and "miniature" not in " ".join(row.name for row in large.rows)
    _, none = sized(delta_v_m_s=20.0, limits={"propulsion": ["ASCENT monopropellant, miniature"]})
    assert none.words == "no thrusters of limits.propulsion are made for 6U"
    # 2 W by 2.5 dB are slower than Iris's 4 W by -0.1 dB: over 0.84 au slower than its slowest rate.
    _, far = sized(units=3, limits={"units": [3]})
    assert far.link.radio == "iris_patch"


def test_several_limits_at_once_are_told_in_their_units():
    _, refused = sized(units=3, delta_v_m_s=385.0, limits={"units": [3], "propulsion": ["ADN monopropellant"]})
    words = re.search(r"exceeds mass by ([0-9.]+) kg and volume by ([0-9.]+) U", refused.words)
    assert words and 0.0 < float(words[1]) < 6.0 and 0.0 < float(words[2]) < 3.0


def test_finer_and_larger_is_harder_to_see():
    one = asked()
    assert asked(resolution_m=0.3).no_harder_to_see(one) and asked(share_percent=80).no_harder_to_see(one)
    assert not asked(resolution_m=0.1).no_harder_to_see(one)
    # Other turns take other wheels, with which other pictures are taken too early.
    for other in (
        {"turn_s": 60},
        {"deliver_within_h": 480},
        {"quality": "stereo"},
        {"probability": 0.9},
        {"margins": {"relief": 1.2}},
        {"scenario": "eros-quick"},
    ):
        assert not asked(resolution_m=0.3, **other).no_harder_to_see(one)


def test_the_ground_moves_by_the_pixels_that_are_allowed():
    for resolution_m in (0.2, 2.0):
        given, fast = asked(resolution_m=resolution_m, max_blur_px=0.5, min_snr=0), SEEN._replace(speed=1e4)
        payload = payload_for(given, fast, SIZES[6], 500.0, DETECTORS[1])
        assert isinstance(payload, Payload)
        assert payload.exposure_s * fast.speed == pytest.approx(0.5 * payload.pixel_rad * 500.0)


@pytest.mark.parametrize("propulsion", PROPULSION)
def test_every_kind_of_thrusters_can_be_flown(propulsion):
    _, one = sized(delta_v_m_s=5.0)
    assert isinstance(one, Spacecraft)
    flown = load_scenario("bennu-slow", replace(one, propulsion=propulsion).changes(asked()))
    assert flown.spacecraft.thrusters is not None and flown.spacecraft.thrusters.thrust_n == propulsion.thrust_n
    assert flown.spacecraft.wheel_layout == "orthogonal"
    momentum = flown.spacecraft.wheel.spin_inertia_kg_m2 * flown.spacecraft.wheel.max_speed_rpm * np.pi / 30.0
    assert momentum == pytest.approx(one.wheels.momentum_n_m_s)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"limits": {"units": [4]}}, "limits.units"),
        ({"limits": {"propulsion": ["steam"]}}, "limits.propulsion"),
        ({"sobol": 12}, "sobol"),
        ({"quality": "pretty"}, "quality"),
        ({"resolution_m": -1}, "resolution_m"),
        (
            {"network": "dsn", "changes": {"link.ground.network": "estrack"}},
            r"link.ground.network: follows from network of the requirement",
        ),
        ({"changes": {"camera.half_angle_deg": 3}}, "camera.half_angle_deg"),
    ],
)
def test_wrong_requirements_are_refused_by_name(changes, words):
    with pytest.raises(ScenarioError, match=words):
        load_requirement({"name": "test", "scenario": "bennu-slow", "resolution_m": 0.2, **changes})


def test_what_flew_already_is_refused_before_anything_is_sized():
    with pytest.raises(ScenarioError, match="initial_states: the swarm designer"):
        encounter_of(load_requirement({"name": "test", "scenario": "refly-lutetia", "resolution_m": 100}))


def test_the_page_of_built_spacecraft_is_current_and_marco_is_met():
    from scripts.pages import sized as built

    page = built.PAGE.read_text("utf-8")
    found = {one.name: built.sized(one) for one in built.BUILT}
    for one in built.BUILT:
        sized_kg = getattr(found[one.name], "mass_kg", None)
        assert f"| {one.mass_kg:g} | {'refused' if sized_kg is None else f'{sized_kg:.1f}'} |" in page
    marco = found["MarCO"]
    assert marco.mass_kg == pytest.approx(13.5, rel=0.15)
    assert marco.available_w * 1.43**2 == pytest.approx(35.0, rel=0.25)


@pytest.mark.parametrize("law", ["lambert", "lommel_seeliger"])
def test_pixels_do_not_overflow_and_lenses_can_be_made(law):
    seen = SEEN._replace(surface=surface_of(Photometry(law=law, albedo=0.15)))
    for changes in ({}, {"resolution_m": 1.0}, {"resolution_m": 0.05}):
        given = asked(**changes)
        payload = payload_for(given, seen, SIZES[12], 1000.0, DETECTORS[1])
        camera = Camera(
            half_angle_deg=1.0,
            aperture_m=payload.aperture_m,
            wavelength_m=550e-9,
            quantum_efficiency=0.5,
            exposure_s=payload.exposure_s,
        )
        # Seen 60 deg off the Sun: ground that faces it, and ground in its light that is seen ever more along itself.
        phase = np.cos(np.radians(60.0))
        across = np.radians(np.arange(0.0, 90.0))
        facing = radiance_factor(seen.surface, 1.0, phase, phase)
        others = [radiance_factor(seen.surface, np.cos(i), np.cos(np.radians(60.0) - i), phase) for i in across]
        found = electrons(camera, payload.pixel_rad, np.array([facing, *others]), seen.sun_m)
        well = camera.detector.exposure_share * camera.detector.full_well_e
        if payload.exposure_s < 0.99 * given.max_blur_px * payload.pixel_rad * 1000.0 / seen.speed:
            assert found[0] == pytest.approx(well)
        assert found[0] <= well * (1.0 + 1e-9) and found.max() < camera.detector.full_well_e
        assert payload.snr < np.sqrt(camera.detector.full_well_e)
        assert payload.focal_m / payload.aperture_m >= 1.4 - 1e-9


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"limits": {"unit": [3]}}, r"limits.unit: unknown key. Did you mean 'units'\? Allowed: units, spacecraft,"),
        ({"margins": {"masses": 0.3}}, r"margins.masses: unknown key. Did you mean 'mass'"),
        ({"limits": None}, r"limits = None: must be a section with the keys units,"),
        ({"delta_v": 20}, r"delta_v: unknown key. Did you mean 'delta_v_m_s'\? Allowed: name, scenario,"),
        ({"seed": 1}, r"seed: unknown key. Allowed: name,"),
        ({"changes": {"observation.max_gsd_m": 3}}, r"observation.max_gsd_m: follows from resolution_m"),
        ({"changes": {"designer": {"max_observers": 3}}}, r"designer.max_observers: follows from limits.spacecraft"),
        ({"changes": {"camera.half_angle_deg": 3}}, r"camera.half_angle_deg: is what is sized"),
        ({"changes": {"link.earth.radio": "dish_30cm"}}, r"link.earth.radio: is chosen by the spacecraft designer"),
        ({"changes": {"design": {"visiting_points": [1]}}}, r"design.visiting_points: is chosen by the swarm designer"),
        (
            {"network": "dsn", "changes": {"link": {"ground": {"network": "estrack"}}}},
            r"link.ground.network: follows from network",
        ),
    ],
)
def test_wrong_requirements_are_told_with_the_keys_of_requirements(given, words):
    with pytest.raises(ScenarioError, match=words):
        load_requirement({"name": "n", "scenario": "bennu-slow", "resolution_m": 1.0, **given})
