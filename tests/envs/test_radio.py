"""Links and the data that go over them, worked out anew by NumPy and trimesh from positions and attitudes."""

import numpy as np
from scipy.spatial.transform import Rotation
from swarm_mj.envs.observe.kinematics import Tracking, no_kinematics
from swarm_mj.envs.observe.radio import RULES, RadioConstants, radio_constants, transmit
from swarm_mj.envs.observe.totals import no_totals

from swarm_mj.dataflow.contacts import Radios
from swarm_mj.dataflow.ground import elevations_deg, stations_from
from swarm_mj.dataflow.link_budget import RateTable, rate_at
from swarm_mj.dataflow.radios import CATALOGUE
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.links import Antennas
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.smallbody.ephemeris import julian_date
from swarm_mj.smallbody.occultation import occluder_of
from swarm_mj.smallbody.shape import ShapeModel

SPEED_OF_LIGHT = 299_792_458.0
#: A small body, off the ways between all that is placed here.
SPECK = occluder_of(
    ShapeModel(
        np.array([[1, 0, -1], [-1, 1, -1], [-1, -1, -1], [0, 0, 1.0]]), [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
    )
)


def sent(
    mode,
    stored,
    *,
    lost=(),
    off=(),
    t=0.0,
    dish_deg=180.0,
    z_N=(0.0, 0.0, 1.0),
    before_N=None,
    table=((1e9, 15.0),),
    earth=12.0,
    room=1e3,
):
    """Data aboard, links and what Earth got after a second of one flight; of two flights the second does not fly."""
    n = len(mode)
    before, now, totals = no_kinematics(2, n, 3), no_kinematics(2, n, 3), no_totals(2, n, 1)
    for at, then, axis_N in ((before, t - 1.0, before_N or z_N), (now, t, z_N)):
        at.t[:], at.r[:] = then, np.column_stack([np.full(n, 5e3), np.full(n, 4e3), 100.0 * np.arange(n)])
        at.C_AN[:] = np.eye(3)
        at.C_BN[:] = Rotation.align_vectors([[0.0, 0.0, 1.0]], [axis_N])[0].as_matrix()
    downlink = np.ones((2, n), bool)
    downlink[0, list(off)] = False
    totals.stored[:] = stored
    totals.lost[0, list(lost)] = True
    kind = np.tile([TargetKind.EARTH if who < 0 else TargetKind.SPACECRAFT for who in mode], (2, 1)).astype(np.int64)
    tracking = Tracking(kind, np.tile(np.maximum(mode, 0), (2, 1)), np.zeros((2, n, 3)), np.zeros((2, n), bool))
    beams = Antennas(
        dish_half_angle=np.radians(dish_deg),
        hemispherical_boresight_B=np.array([0.0, 0.0, 1.0]),
        hemispherical_half_angle=np.pi,
        max_range=1e9,
    )
    # Earth goes from along x to along y in 1000 s.
    r, v, rates = np.array([1e11, 0.0, 0.0]), np.array([-1e8, 1e8, 0.0]), np.array(table)
    # One station for each step, in reach of any.
    heard = RateTable(np.full((len(np.atleast_1d(earth)), 1), np.inf), np.atleast_1d(earth)[:, None].astype(float))
    radios = Radios(beams, RateTable(rates[:, 0].copy(), rates[:, 1].copy()), heard)
    constants = RadioConstants(SPECK, radios, RULES, r, v, 1.0, np.arange(len(heard.range_m)), int(room))
    transmit(constants, before, now, tracking, downlink, totals, np.array([True, False]))
    received = totals.delivered.sum(axis=1)
    assert received[1] == 0.0 and totals.stored[1].tolist() == list(stored)
    assert received[0] == sum(stored) - totals.stored[0].sum()
    return totals.stored[0].tolist(), totals.closed[0].tolist(), received[0]


def test_data_move_at_their_rates_and_earth_hears_one_after_the_other():
    # The first sends its 10, the third the 2 that the step has left; the second sends 15 to the first, which keeps them.
    assert sent([-1, 0, -1], [10.0, 20.0, 30.0]) == ([15.0, 5.0, 28.0], [True, True, True], 12.0)
    assert sent([-1, 0, -1], [2.0, 1.0, 30.0]) == ([1.0, 0.0, 20.0], [True, True, True], 12.0)


def test_who_is_lost_neither_sends_nor_hears():
    assert sent([-1, 0, -1], [10.0, 20.0, 30.0], lost=[0]) == ([10.0, 20.0, 18.0], [False, False, True], 12.0)


def test_who_has_lost_its_link_to_earth_still_relays():
    assert sent([-1, 0, -1], [10.0, 20.0, 30.0], off=[0]) == ([25.0, 5.0, 18.0], [False, True, True], 12.0)


def test_a_link_that_closes_or_opens_on_the_way_carries_half():
    dish = {"dish_deg": 5.0, "t": 0.0}
    assert sent([-1], [50.0], z_N=[1, 0, 0], before_N=[0, 1, 0], **dish)[1:] == ([True], 6.0)
    assert sent([-1], [50.0], z_N=[0, 1, 0], before_N=[1, 0, 0], **dish)[1:] == ([False], 6.0)


def test_a_dish_that_points_to_where_earth_is_now_reaches_it():
    for t, z_N, closed in (
        (0.0, [1, 0, 0], True),
        (0.0, [0, 1, 0], False),
        (1e3, [0, 1, 0], True),
        (1e3, [1, 0, 0], False),
    ):
        assert sent([-1], [50.0], t=t, dish_deg=5.0, z_N=z_N)[1] == [closed]


def test_a_crosslink_carries_the_fastest_rate_that_reaches_and_none_is_closed_beyond():
    # They stand 100 m apart in a row.
    moved = sent([-1, 0, 0, 0], [0.0, 50.0, 50.0, 50.0], table=((150.0, 15.0), (250.0, 6.0)), earth=0.0)
    assert moved == ([21.0, 35.0, 44.0, 50.0], [False, True, True, False], 0.0)


def test_a_receiver_takes_no_more_than_it_has_room_for():
    assert sent([-1, 0, 0], [30.0, 20.0, 20.0], room=40.0, earth=0.0)[0] == [40.0, 10.0, 20.0]
    assert sent([1, 0], [40.0, 35.0], room=40.0)[0] == [40.0, 35.0]  # the first gives 5, which makes room for 5


def test_earth_hears_between_two_instants_the_mean_of_what_its_stations_hear_at_them():
    assert [sent([-1], [50.0], t=t, earth=[2.0, 2.0, 4.0, 0.0])[1:] for t in (1.0, 2.0, 3.0)] == [
        ([True], 2.0),
        ([True], 3.0),
        ([False], 2.0),
    ]


def friis_bit_s(radio, g_over_t_db_k, distance):
    """The fastest step of a radio that closes with margin, by products instead of decibels; narrow bands are no limit here."""
    ratio = [10.0 ** (x / 10.0) for x in (radio.gain_dbi - radio.losses_db, g_over_t_db_k)]
    needed = 10.0 ** ((radio.required_eb_n0_db + radio.margin_db) / 10.0)
    received = (
        radio.power_w * ratio[0] * ratio[1] * (SPEED_OF_LIGHT / radio.frequency_hz / (4.0 * np.pi * distance)) ** 2
    )
    return max((rate for rate in radio.rates_bit_s if received / 1.380649e-23 >= needed * rate), default=0.0)


def test_by_the_link_budget_earth_hears_while_a_station_sees_the_body():
    own = "link.ground.stations=[{name: A, latitude_deg: 10, longitude_deg: %s, g_over_t_db_k: 60}]"
    times, radio = np.arange(0.0, 1501.0, 10.0), CATALOGUE["iris_reflectarray"]
    for longitude in (0, 90, 180, 270):
        scenario = load_scenario("eros-observe", parse_overrides([own % longitude]))
        plan = make_plan(scenario)
        earth_N = np.array([plan.environment.earth.at(t) for t in times])
        light_s = np.linalg.norm(earth_N, axis=1) / SPEED_OF_LIGHT
        jd = julian_date(scenario.epoch) + (times + light_s) / 86_400.0
        elevation = elevations_deg(stations_from(scenario.link.ground), jd, -earth_N)[:, 0]
        if elevation.min() > 20.0 and np.ptp(elevation) > 1.0:
            break
    mask = elevation[60]
    plan = make_plan(
        load_scenario("eros-observe", parse_overrides([own % longitude, f"link.ground.min_elevation_deg={mask}"]))
    )
    expected = [friis_bit_s(radio, 60.0, d) for d in np.linalg.norm(earth_N, axis=1)] * (elevation >= mask)
    constants = radio_constants(plan, times, swarm_rate_bit_s=None, earth_rate_bit_s=None)
    assert (constants.station == np.where(elevation >= mask, 0, -1)).all()
    table = RateTable(*(rows[0] for rows in constants.radios.earth))
    told = np.array([rate_at(table, d) for d in np.linalg.norm(earth_N, axis=1)]) * (constants.station == 0)
    assert told.tolist() == expected.tolist()
    assert 0 < np.count_nonzero(expected) < len(times) and expected.max() > 0.0
