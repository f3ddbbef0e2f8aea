"""A scenario flown: planned (`plan`), simulated (`fly`), observed (`observe`)."""

from __future__ import annotations

from typing import Any

from swarm_mj.moved import renamed

#: Where the names of version 0.1's module are now.
_HOMES = {
    **dict.fromkeys(("simulate", "make_simulation", "initial_state"), "swarm_mj.flight.fly"),
    **dict.fromkeys(
        ("ObservationResult", "observe_flight", "add_coverage", "picture_count"), "swarm_mj.flight.observe"
    ),
}


def __getattr__(name: str) -> Any:
    """Names of version 0.1, with a warning."""
    return renamed(__name__, _HOMES, name)
