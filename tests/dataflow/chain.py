"""A network that can be worked out in the head."""

import numpy as np

from swarm_mj.dataflow.network import Access, Network


def chain(**given):
    """Spacecraft 0 has a tile of 8 bits and passes it to 1 in slots 0 and 1; 1 is heard by Earth in slots 1 to 3."""
    swarm, earth = np.zeros((4, 2, 2), np.int64), np.zeros((4, 2), np.int64)
    swarm[:2, 0, 1], earth[1:, 1] = 4, 4
    fields = {
        "edges_s": np.array([0.0, 10.0, 20.0, 30.0, 40.0]),
        "swarm_bit": swarm,
        "earth_bit": earth,
        "storage_bit": np.array([8, 8]),
        "access": Access.ONE_AT_A_TIME,
        "half_duplex": True,
        "earth_channels": 1,
        "value": np.array([100.0]),
        "bits": np.array([[8], [0]]),
        "ready": np.array([[0], [4]]),
    }
    return Network(**(fields | given))
