"""Strategies of hypothesis for scenarios: from nearly right to hostile."""

from typing import Literal, get_args, get_origin

from hypothesis import strategies as st
from pydantic import BaseModel

from swarm_mj.scenarios.schema import Scenario

#: A flight of ten minutes that takes well under a second.
BASE = {
    "name": "fuzzed",
    "duration_s": 600.0,
    "design": {"visiting_points": [12, 40], "time_of_flight_s": 600.0},
    "behavior": {"name": "adaptable_roles"},
    "physics": {"timestep_s": 0.5},
    "camera": {"resolution_px": 64},
    "observation": {"interval_s": 100.0, "observer": "raycast"},
    "telemetry": {"interval_s": 10.0},
}
#: Arguments of plug-ins, which the schema does not know.
PARAMETERS = {
    ("control", "parameters", key): 1.0
    for key in ("slope", "rate_limit", "reaching_rate", "layer", "damping", "disturbance_torque", "inertia_uncertainty",
                "frequency", "nonsense")
} | {
    ("body", "gravity", "parameters", key): value
    for key, value in (("gm", 4.5e5), ("reference_radius_m", 16e3), ("coefficients", [[2, 0, -0.05, 0.0]]))
} | {("behavior", "parameters", "election"): "first"}  # fmt: skip


def leaves(model=Scenario, path=()):
    """Every value of the schema as (path, default)."""
    for name, field in model.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from leaves(kind, (*path, name))
        else:
            default = field.get_default(call_default_factory=True)
            yield (*path, name), kind, default


LEAVES = [*leaves(), *((path, type(value), value) for path, value in PARAMETERS.items())]

EXTREME = st.sampled_from(
    [
        0,
        -1,
        1,
        1e-320,
        1e-12,
        1e-3,
        1e3,
        1e9,
        1e18,
        1e300,
        -1e300,
        2**63,
        10**400,
        float("nan"),
        float("inf"),
        -float("inf"),
    ]
)
JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20) | EXTREME,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)


@st.composite
def near(draw, default):
    """A number some powers of ten away from one that is right; powers of ten keep times multiples of each other."""
    exponent = draw(st.sampled_from([-1, 1, 2]) | st.integers(-12, 12) | st.floats(-12, 12))
    factor = 10.0**exponent * draw(st.sampled_from([1, 1, 1, 2, 3, -1]))
    value = (default or 1.0) * factor
    return round(value) if isinstance(default, int) and abs(value) < 1e15 else value


def values(kind, default):
    """Values for one key: believable, on the edge, or nonsense."""
    if get_origin(kind) is Literal or kind is str and not isinstance(default, str):
        options = st.sampled_from(get_args(kind) or ("",))
        return st.one_of(options, options, options, JUNK)
    if isinstance(default, bool):
        return st.booleans() | JUNK
    if isinstance(default, int | float):
        return st.one_of(*[near(default)] * 6, EXTREME, JUNK)
    if isinstance(default, tuple | list) and default and isinstance(default[0], int | float):
        each = st.one_of(near(float(default[0])), EXTREME, st.integers(1, 60))
        right_length = st.lists(each, min_size=len(default), max_size=len(default))
        return st.one_of(right_length, right_length, st.lists(each, max_size=6), JUNK)
    return st.one_of(*[near(1.0)] * 4, EXTREME, JUNK)


@st.composite
def overrides(draw, count=3):
    """Up to `count` changed values as (path, value)."""
    chosen = draw(st.lists(st.sampled_from(LEAVES), min_size=1, max_size=count))
    return [(path, draw(values(kind, default))) for path, kind, default in chosen]


def changed(base, changes):
    """A copy of a scenario's mapping with values put into it."""
    data = {key: dict(value) if isinstance(value, dict) else value for key, value in base.items()}
    for path, value in changes:
        node = data
        for name in path[:-1]:
            child = node.get(name)
            node[name] = dict(child) if isinstance(child, dict) else {}
            node = node[name]
        node[path[-1]] = value
    return data
