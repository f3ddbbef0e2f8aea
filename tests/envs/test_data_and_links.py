"""Data volume of pictures and the reading `link`, worked out anew by NumPy and trimesh from positions and attitudes."""

import numpy as np
import pytest
import trimesh

from swarm_mj.scenarios.loading import load_scenario

from .flights import BOTH, CENTRE, EARTH, HOLD, SC1, angle_deg

#: Ground sampling distance over range of the scenario's camera: 2.5 deg half-angle, 512 pixels.
PIXEL = 2.0 * np.tan(np.radians(2.5)) / 512.0


@BOTH
@pytest.mark.parametrize("observer", ["horizon", "raycast"])
def test_a_picture_adds_the_imaged_area_over_the_foreshortened_ground_sampling_distance(begin, kind, observer):
    flights = begin(kind, observer=observer, bits_per_pixel=2.5)
    region, plan = flights.plan.region, flights.plan
    corners = region.vertices[region.faces[region.target]]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area, centre = 0.5 * np.linalg.norm(across, axis=1), corners.mean(axis=1)
    normal = across / np.linalg.norm(across, axis=1)[:, None]
    nominal = 2.5 * area.sum() / (14_000.0 * PIXEL) ** 2
    expected, before = np.zeros(flights.count), flights.gather(lambda batch: batch.totals.seen)
    for k in range(70):
        r_A = np.einsum("ij,ej->ei", plan.environment.C_AN(10.0 * k), flights.r_N[:, 0])  # when the picture is taken
        observations, _, infos = flights.step(np.array([5 + k // 35, HOLD, HOLD, HOLD, HOLD]))
        now = flights.gather(lambda batch: batch.totals.seen)
        for e, new in enumerate(now & ~before):
            way = r_A[e] - centre[new]
            distance = np.linalg.norm(way, axis=1)
            cosine = (way * normal[new]).sum(axis=1) / distance
            expected[e] += 2.5 * (area[new] * cosine / (PIXEL * distance) ** 2).sum()
        before = now
        stored = np.atleast_2d(infos["stored_bit"])
        assert stored[:, 0] == pytest.approx(expected, rel=1e-9)
        assert (stored[:, 1:] == 0.0).all()
        assert flights.parts(observations)["stored"][:, 0, 0] == pytest.approx(expected / nominal, rel=1e-6)
    assert (expected > 0.005 * nominal).all()


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
def test_the_reading_link_tells_where_dish_antenna_range_and_body_leave_the_way_open(begin, kind):
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
