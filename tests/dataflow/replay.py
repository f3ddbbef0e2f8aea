"""Whether a schedule can be flown: every rule of the network, slot by slot, in plain loops."""

import numpy as np

from swarm_mj.dataflow.network import Access

TOLERANCE = 1e-7


def replay(network, schedule):
    """Fly a schedule; returns the bits that are on Earth at the end."""
    n, q = network.n_spacecraft, network.n_tiles
    aboard, on_earth = np.zeros(n), 0.0
    assert (schedule.taken >= 0).all() and (schedule.taken.sum(axis=0) <= 1 + TOLERANCE).all()
    assert not schedule.taken[network.bits == 0].any()
    for t in range(network.n_slots):
        for i in range(n):
            if network.lost_slot[i] == t:
                assert aboard[i] <= TOLERANCE, "bits on their way to Earth are lost"
            for tile in range(q):
                if network.ready[i, tile] == t and schedule.taken[i, tile]:
                    assert network.lost_slot[i] > t
                    aboard[i] += schedule.taken[i, tile] * network.bits[i, tile]
        assert (aboard <= network.storage_bit + TOLERANCE).all()
        assert np.allclose(aboard, schedule.aboard_bit[t], atol=TOLERANCE)
        swarm, earth = schedule.swarm_bit[t], schedule.earth_bit[t]
        assert (swarm.sum(axis=1) + earth <= aboard + TOLERANCE).all(), "sent before it is aboard"
        check_shares(network, t, swarm, earth)
        aboard = aboard - swarm.sum(axis=1) - earth + swarm.sum(axis=0)
        on_earth += earth.sum()
    assert np.allclose(aboard, 0.0, atol=TOLERANCE) and np.allclose(schedule.aboard_bit[-1], 0.0, atol=TOLERANCE)
    return on_earth


def check_shares(network, t, swarm, earth):
    """Nobody sends over an open link or without a turn; swarm is (n, n) and earth (n,) in bits."""
    assert not swarm[network.swarm_bit[t] == 0].any() and not earth[network.earth_bit[t] == 0].any()
    shares = swarm / np.maximum(network.swarm_bit[t], 1)
    to_earth = earth / np.maximum(network.earth_bit[t], 1)
    assert not swarm[network.lost_slot <= t].any() and not earth[network.lost_slot <= t].any()
    assert (shares >= 0).all() and (to_earth >= 0).all()
    assert (to_earth <= 1 + TOLERANCE).all() and to_earth.sum() <= network.earth_channels + TOLERANCE
    sends, receives = shares.sum(axis=1), shares.sum(axis=0)
    if network.access is Access.ONE_AT_A_TIME:
        assert sends.sum() <= 1 + TOLERANCE
    elif network.access is Access.TDMA:
        assert (sends <= 1 / network.n_spacecraft + TOLERANCE).all()
    else:
        assert (sends <= 1 + TOLERANCE).all()
    if network.half_duplex and network.access is not Access.ONE_AT_A_TIME:
        assert (sends + receives <= 1 + TOLERANCE).all()
