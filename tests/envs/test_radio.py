"""Links and the data that go over them, worked out anew by NumPy and trimesh from positions and attitudes."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from swarm_mj.envs.kinematics import Tracking, no_kinematics
from swarm_mj.envs.radio import RadioConstants, transmit
from swarm_mj.envs.totals import no_totals

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.links import Antennas
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.smallbody.occultation import occluder_of
from swarm_mj.smallbody.shape import ShapeModel

from .flights import BOTH, CENTRE, EARTH, HOLD, PIXEL, SC1, angle_deg


@BOTH
def test_data_delivered_count_by_the_nominal_volume(begin, kind):
    flights = begin(kind)
    nominal = flights.plan.region.area.sum() / (14_000.0 * PIXEL) ** 2
    for _ in range(60):
        flights.step(np.array([5, HOLD, HOLD, HOLD, HOLD]))
    got, before = np.zeros(flights.count), np.zeros(flights.count)
    for _ in range(20):
        observations, terms, infos = flights.step(np.array([EARTH, HOLD, HOLD, HOLD, HOLD]))
        delivered = np.atleast_1d(infos["delivered_bit"])
        assert terms["delivered"] == pytest.approx((delivered - before) / nominal, rel=1e-9)
        assert flights.parts(observations)["delivered"] == pytest.approx(delivered / nominal, rel=1e-6)
        got, before = got + terms["delivered"], delivered
    assert got.max() > 1e-3


@BOTH
def test_the_observation_link_tells_where_dish_antenna_range_and_body_leave_the_way_open(begin, kind):
    # Narrower and shorter than usual, so that both matter.
    half_angle, reach = 88.0, 2500.0
    changes = [f"link.max_range_m={reach}", f"link.hemispherical_half_angle_deg={half_angle}"]
    flights = begin(kind, scenario=load_scenario("eros-observe", changes))
    body = trimesh.Trimesh(flights.plan.shape.vertices, flights.plan.shape.faces, process=False)
    told, why = [], {"dish": 0, "antenna": 0, "range": 0}
    for k in range(60):
        to_sc1 = np.array([EARTH, SC1, SC1, SC1, SC1])
        observations, *_ = flights.step(np.full(5, CENTRE) if k % 20 < 8 else to_sc1)
        link = flights.parts(observations)["link"][:, :, 0]
        if k % 20 < 8:
            assert (link == 0.0).all()  # who observes does not talk
            continue
        environment, r, C = flights.plan.environment, flights.r_N, flights.C_BN
        C_AN = environment.C_AN(flights.t)
        for e in range(flights.count):
            for j in range(5):
                end = environment.earth.at(flights.t) if j == 0 else r[e, 0]
                way = end - r[e, j]
                closed = angle_deg(way, C[e, j, 2]) <= 5.0
                why["dish"] += not closed
                if closed and j > 0:
                    heard, near = angle_deg(-way, -C[e, 0, 2]) <= half_angle, np.linalg.norm(way) <= reach
                    why["antenna"] += not heard
                    why["range"] += heard and not near
                    closed = heard and near
                if closed:
                    hit = body.ray.intersects_location([C_AN @ r[e, j]], [C_AN @ way], multiple_hits=False)[0]
                    closed = not len(hit) or np.linalg.norm(hit[0] - C_AN @ r[e, j]) > np.linalg.norm(way)
                assert link[e, j] == closed
                told.append(closed)
    assert 0.1 < np.mean(told) < 0.9
    assert min(why.values()) > 0, why


def test_earth_receives_at_its_rate_and_only_while_the_dish_points_there(roles):
    roles.reset(seed=0)
    for _ in range(60):
        roles.step(np.array([5, 6, 9, 10, CENTRE]))
    open_steps = closed_steps = 0
    for _ in range(40):
        stored, before = roles.batch.totals.stored[0].copy(), roles.batch.totals.delivered[0]
        *_, info = roles.step(np.array([EARTH, HOLD, HOLD, HOLD, HOLD]))
        state = roles.state
        to_earth = roles.plan.environment.earth.at(state.t) - state.r_BN_N[0]
        angle = np.degrees(np.arccos(np.clip(state.boresight_N[0] @ to_earth / np.linalg.norm(to_earth), -1, 1)))
        expected = min(stored[0], 8e3 * 10.0) if angle < 5.0 else 0.0
        assert info["delivered_bit"] - before == pytest.approx(expected, abs=1e-6)
        open_steps, closed_steps = open_steps + (angle >= 5.0), closed_steps + (angle < 5.0)
    assert open_steps > 0 and closed_steps > 10


#: A small body, off the ways between all that is placed here.
SPECK = occluder_of(
    ShapeModel(
        np.array([[1, 0, -1], [-1, 1, -1], [-1, -1, -1], [0, 0, 1.0]]), [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
    )
)


def sent(mode, stored, *, lost=(), t=0.0, dish_deg=180.0, z_N=(0.0, 0.0, 1.0)):
    """Data aboard, links and what Earth got after a step of one flight; of two flights the second does not fly."""
    n = len(mode)
    now, totals = no_kinematics(2, n, 3), no_totals(2, n, 1)
    now.t[:], now.r[:] = t, np.column_stack([np.full(n, 5e3), np.full(n, 4e3), 100.0 * np.arange(n)])
    now.C_AN[:] = np.eye(3)
    now.C_BN[:] = Rotation.align_vectors([[0.0, 0.0, 1.0]], [z_N])[0].as_matrix()
    totals.stored[:] = stored
    totals.lost[0, list(lost)] = True
    kind = np.tile([TargetKind.EARTH if who < 0 else TargetKind.SPACECRAFT for who in mode], (2, 1)).astype(np.int64)
    tracking = Tracking(kind, np.tile(np.maximum(mode, 0), (2, 1)), np.zeros((2, n, 3)), np.zeros((2, n), bool))
    beams = Antennas(
        dish_half_angle=np.radians(dish_deg),
        hemispherical_boresight_B=np.array([0.0, 0.0, 1.0]),
        hemispherical_half_angle=np.pi,
        max_range=1e9,
    ).beams
    # Earth goes from along x to along y in 1000 s.
    constants = RadioConstants(beams, np.array([1e11, 0.0, 0.0]), np.array([-1e8, 1e8, 0.0]), 15.0, 12.0)
    received = transmit(constants, SPECK, now, tracking, totals, np.array([True, False]))
    assert received[1] == totals.delivered[1] == 0.0 and totals.stored[1].tolist() == list(stored)
    assert totals.delivered[0] == received[0] == sum(stored) - totals.stored[0].sum()
    return totals.stored[0].tolist(), totals.closed[0].tolist(), received[0]


def test_data_move_at_their_rates_and_earth_hears_one_after_the_other():
    # The second sends 15 to the first, which sends 12 on; nothing is left of the step for the third.
    assert sent([-1, 0, -1], [10.0, 20.0, 30.0]) == ([13.0, 5.0, 30.0], [True, True, True], 12.0)
    assert sent([-1, 0, -1], [2.0, 1.0, 30.0]) == ([0.0, 0.0, 21.0], [True, True, True], 12.0)


def test_who_is_lost_neither_sends_nor_hears():
    assert sent([-1, 0, -1], [10.0, 20.0, 30.0], lost=[0]) == ([10.0, 20.0, 18.0], [False, False, True], 12.0)


def test_a_dish_that_points_to_where_earth_is_now_reaches_it():
    for t, z_N, closed in (
        (0.0, [1, 0, 0], True),
        (0.0, [0, 1, 0], False),
        (1e3, [0, 1, 0], True),
        (1e3, [1, 0, 0], False),
    ):
        assert sent([-1], [50.0], t=t, dish_deg=5.0, z_N=z_N)[1] == [closed]
