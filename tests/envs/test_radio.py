"""Links and the data that go over them, worked out anew by NumPy and trimesh from positions and attitudes."""

import numpy as np
import pytest
import trimesh

from swarm_mj.scenarios.loading import load_scenario

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
