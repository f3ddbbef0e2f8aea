"""What faults and dispersions make of one flight, for compiled code: masses, wheels and sensors as they really are.

The arrays belong to `FaultInjection`, whose Python changes them in place when something happens. As those of MuJoCo in
`mj_memory`, they are described once by their addresses, so that flights with conditions of their own are flown by one call.
Wheels and sensors are driven and read by C functions that are called by address, as control laws are: who flies as planned
never compiles them.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from llvmlite import ir
from numba import cfunc, from_dtype, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from swarm_mj.simulator.fast.kernels import weigh
from swarm_mj.simulator.fast.mj_memory import array_of, numbers_at
from swarm_mj.simulator.faults.filter_state import Assumed, FilterState, Sensors
from swarm_mj.simulator.faults.sensing_kernels import Count, Knowledge, sense
from swarm_mj.simulator.faults.wheels import WheelState, drive
from swarm_mj.spacecraft.attitude.lanes import room
from swarm_mj.typing import Array, Ints, Mask, inlined, jittable, kernel

_SIZES = ("sense", "command", "n", "m", "w", "own_field", "estimating", "readings", "noise_rows")
_OF_KNOWLEDGE = ("noise", "counts", "delay", "q_past", "omega_past", "q_known", "omega_known")
_OF_ASSUMED = tuple(f"assumed_{name}" for name in Assumed._fields)
_OF_FILTER = tuple(f"filter_{name}" for name in FilterState._fields)
_OF_CRAFT = ("series", "mass_ratio", "inertia_B", "dead", "wheel_speed", "last_r")
_ARRAYS = (*_OF_CRAFT, *WheelState._fields, *Sensors._fields, *_OF_FILTER, *_OF_KNOWLEDGE)
#: The conditions of one flight: addresses of the functions that read its sensors and drive its wheels (0: they are as planned);
#: sizes, and whether it has a gravity field of its own; numbers; addresses of the arrays that `described` names.
CONDITION = np.dtype(
    [(name, np.int64) for name in _SIZES]
    + [(name, np.float64) for name in ("field_factor", "period", "max_torque", "max_speed", *_OF_ASSUMED)]
    + [(name, np.int64) for name in _ARRAYS]
)
#: What arrays may hold, as they say it themselves: asking them for more takes as long as the rest of a reset.
_KINDS = frozenset(np.dtype(kind).str for kind in (np.float64, np.int64, np.bool_))
_FIELDS = tuple(CONDITION.names or ())
#: Those of E flights, with dtype `CONDITION`, shape (E,); all zeros: the flight is as planned.
Conditions: TypeAlias = NDArray[np.void]


def described(arrays: Mapping[str, Array], known: Knowledge, **numbers: float) -> tuple[float, ...]:
    """Where the conditions of a flight stand, as an entry of `Conditions`; valid as long as all that is given here lives.

    Args:
        arrays: By name: `mass_ratio`, true over planned, shape (n,); `inertia_B`, in truth, (n, 3, 3) [kg m^2]; `dead`, who has
            no power, (n,); `wheel_speed`, of all wheels at the last decision, (n, w) [rad/s]; `last_r`, positions then, (n, 3)
            [m]; those of `WheelState`; and `series`, coefficients of the gravity field's harmonics in the shape of the
            planned ones, which may be left out.
        known: What the flight software knows.
        numbers: `field_factor`, by which the gravity field is stronger than planned; `period`, of control [s]; `max_torque`, of
            a motor [N m]; `max_speed`, of a wheel [rad/s].
    """
    n, w = arrays["wheel_speed"].shape
    values: dict[str, float] = numbers | dict(zip(_OF_ASSUMED, known.assumed, strict=True))
    values |= {"n": n, "m": room(n), "w": w, "series": 0, "command": _compiled(_command).address}
    values["own_field"] = "series" in arrays or numbers["field_factor"] != 1.0
    senses = bool(known.estimating) or len(known.q_past) > 1
    values["sense"] = _compiled(_sense).address if senses else 0
    values |= {"estimating": known.estimating, "readings": len(known.q_past), "noise_rows": len(known.noise)}
    found: dict[str, Any] = dict(arrays)
    of_sensors = (*Sensors._fields, *_OF_FILTER, *_OF_KNOWLEDGE)
    if senses:
        own = (known.noise, known.counts, known.delay, known.q_past, known.omega_past, known.q_BN, known.omega_BN_B)
        found |= dict(zip(of_sensors, (*known.sensors, *known.state, *own), strict=True))
    else:
        values |= dict.fromkeys(of_sensors, 0)
    for name, array in found.items():
        at = array.__array_interface__
        assert at["strides"] is None and at["typestr"] in _KINDS, name
        values[name] = at["data"][0]
    return tuple(values[name] for name in _FIELDS)


_numbers, _whole, _flags = numbers_at, array_of(types.int64), array_of(types.boolean)


@jittable
def weigh_flight(conditions: Conditions, e: int, hub: Ints, xfrc: Array) -> None:
    """Let gravity pull with the true masses, where a flight has conditions; see `kernels.weigh`."""
    if conditions[e].command != 0:
        weigh(_numbers(conditions[e].mass_ratio, conditions[e].n), hub, xfrc)


@inlined
def inertia_of(conditions: Conditions, e: int, planned: Array) -> Array:
    """True inertias of a flight, shape (n, 3, 3) [kg m^2]."""
    if conditions[e].command == 0:
        return planned
    return _numbers(conditions[e].inertia_B, planned.shape)


@inlined
def series_of(conditions: Conditions, e: int, planned: Array) -> Array:
    """Coefficients of the harmonics of a flight's gravity field."""
    if conditions[e].series == 0:
        return planned
    return _numbers(conditions[e].series, planned.shape)


@jittable
def remember(conditions: Conditions, e: int, qvel: Array, r_N: Array) -> None:
    """Note wheel speeds and places of a flight that has conditions, for its wheels and for Python.

    Args:
        conditions: Of all flights.
        e: Number of the flight.
        qvel: Velocities, see `Flights`.
        r_N: Positions, shape (n, 3) [m].
    """
    n, w = conditions[e].n, conditions[e].w
    speed, last_r = _numbers(conditions[e].wheel_speed, (n, w)), _numbers(conditions[e].last_r, (n, 3))
    for j in range(n):
        for k in range(3):
            last_r[j, k] = r_N[j, k]
        for k in range(w):
            speed[j, k] = qvel[(6 + w) * j + 6 + k]


@kernel
def noise_left(conditions: Conditions, live: Mask, tick: Ints, until: Ints, dry: Mask) -> bool:
    """How far noise has been drawn for the readings of the live flights, shape (E,).

    Args:
        conditions: Of all flights.
        live: Which flights.
        tick: Control periods flown.
        until: Brought down to the ticks that they can be flown to.
        dry: Receives whose noise is used up.

    Returns:
        Whether that of any is.
    """
    for e in range(live.shape[0]):
        dry[e] = False
        if live[e] and conditions[e].estimating != 0:
            left = conditions[e].noise_rows - _whole(conditions[e].counts, 3)[Count.NOISE]
            until[e], dry[e] = min(until[e], tick[e] + left), left == 0
    return bool(dry.any())


@inlined
def known_attitudes(conditions: Conditions, e: int, q_BN: Array) -> Array:
    """Attitudes that the controller of a flight is given, shape (n, 4): the truth unless sensors err."""
    if conditions[e].sense == 0:
        return q_BN
    return _numbers(conditions[e].q_known, q_BN.shape)


@inlined
def _wheels_of(at: Any) -> WheelState:
    n, w = at.n, at.w
    return WheelState(
        _numbers(at.effectiveness, (n, w)),
        _flags(at.stuck, (n, w)),
        _numbers(at.stuck_speed, (n, w)),
        _numbers(at.coulomb, (n, w)),
        _numbers(at.viscous, (n, w)),
        _numbers(at.allocation, (n, w, 3)),
        _numbers(at.inertia, (n, w)),
        _numbers(at.motor, (n, w)),
        _numbers(at.bearing, (n, w)),
    )


@inlined
def _knowledge_of(at: Any, n: int) -> Knowledge:
    return Knowledge(
        at.estimating,
        Sensors(
            _numbers(at.gyro_noise, at.m),
            _numbers(at.bias_walk, at.m),
            _numbers(at.star_tracker_noise, at.m),
            _numbers(at.gyro_offset, (3, at.m)),
            _numbers(at.star_tracker_offset, (3, at.m)),
            _flags(at.gyro_works, at.m),
            _flags(at.star_tracker_works, at.m),
        ),
        Assumed(at.assumed_gyro_noise, at.assumed_bias_walk, at.assumed_star_tracker_noise, at.assumed_initial_bias),
        FilterState(
            _numbers(at.filter_q_BN, (n, 4)),
            _numbers(at.filter_omega_BN_B, (n, 3)),
            _numbers(at.filter_bias, (3, at.m)),
            _numbers(at.filter_covariance, (21, at.m)),
            _numbers(at.filter_true_bias, (3, at.m)),
            _numbers(at.filter_q_before, (4, at.m)),
            _numbers(at.filter_q_tracked, (4, at.m)),
            _flags(at.filter_tracked, at.m),
            _flags(at.filter_started, 1),
        ),
        _numbers(at.noise, (at.noise_rows, n, 3, 3)),
        _whole(at.counts, 3),
        _whole(at.delay, n),
        _numbers(at.q_past, (at.readings, n, 4)),
        _numbers(at.omega_past, (at.readings, n, 3)),
        _numbers(at.q_known, (n, 4)),
        _numbers(at.omega_known, (n, 3)),
    )


_CONDITIONS = types.Array(from_dtype(CONDITION), 1, "C")
_vectors, _row, _mask = (
    types.Array(types.float64, 2, "C"),
    types.Array(types.float64, 1, "C"),
    types.Array(types.boolean, 1, "C"),
)
_SENSE = types.void(_CONDITIONS, types.int64, types.int64, types.float64, _vectors, _vectors)
_COMMAND = types.float64(_CONDITIONS, types.int64, _vectors, _mask, _row, _vectors)


def _sense(conditions: Conditions, e: int, tick: int, period: float, q_BN: Array, omega_BN_B: Array) -> None:
    known = _knowledge_of(conditions[e], conditions[e].n)
    sense(tick, q_BN, omega_BN_B, period, known)
    for j in range(omega_BN_B.shape[0]):
        for k in range(3):
            omega_BN_B[j, k] = known.omega_BN_B[j, k]


def _command(conditions: Conditions, e: int, torque_B: Array, released: Mask, ctrl: Array, peaks: Array) -> float:
    at = conditions[e]
    n, w = at.n, at.w
    wheels, speed, dead = _wheels_of(at), _numbers(at.wheel_speed, (n, w)), _flags(at.dead, n)
    drive(torque_B, wheels, speed, at.period, at.max_torque, at.max_speed, dead, peaks)
    effort = 0.0
    for j in range(n):
        for k in range(w):
            ctrl[w * j + k] = wheels.motor[j, k] + wheels.bearing[j, k] if released[j] else 0.0
            effort += wheels.motor[j, k] * wheels.motor[j, k]
    return effort


@cache
def _compiled(function: Any) -> Any:
    """The C function of one of these; kept for the life of the process, and in Numba's cache beyond it."""
    return cfunc(_SENSE if function is _sense else _COMMAND, cache=True, error_model="numpy")(function)


@intrinsic
def call_sense(
    typing_context: Any,
    address: Any,
    conditions: Any,
    e: Any,
    tick: Any,
    period: Any,
    q_BN: Any,
    omega_BN_B: Any,
) -> tuple[Any, Any]:
    """Read the sensors of flight e at a tick: puts the rates that the flight software has in the place of the true ones.

    Args:
        typing_context: Numba's.
        address: `sense` of its condition.
        conditions: Of all flights.
        e: Number of the flight.
        tick: Control periods flown.
        period: [s].
        q_BN: True attitudes, shape (n, 4).
        omega_BN_B: True rates, replaced, shape (n, 3) [rad/s].
    """
    return types.void(types.int64, *_SENSE.args), _call_at(_SENSE)


@intrinsic
def call_command(
    typing_context: Any,
    address: Any,
    conditions: Any,
    e: Any,
    torque_B: Any,
    released: Any,
    ctrl: Any,
    peaks: Any,
) -> tuple[Any, Any]:
    """Drive the wheels of flight e as they are; returns the sum of the squares of the motor torques [N^2 m^2].

    Args:
        typing_context: Numba's.
        address: `command` of its condition.
        conditions: Of all flights.
        e: Number of the flight; `remember` has been told of its state.
        torque_B: Torques on the bodies, shape (n, 3) [N m].
        released: Who has left the mothership, shape (n,).
        ctrl: Receives the torques of motors and bearings together, shape (n w,) [N m].
        peaks: Brought up to date, see `Peak`.
    """
    return types.float64(types.int64, *_COMMAND.args), _call_at(_COMMAND)


def _call_at(kind: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        parameters = [context.get_value_type(each) for each in kind.args]
        function = ir.FunctionType(context.get_value_type(kind.return_type), parameters)
        answer = builder.call(builder.inttoptr(arguments[0], function.as_pointer()), arguments[1:])
        return context.get_dummy_value() if kind.return_type is types.void else answer

    return generate
