"""A flight as a recording that Vizard plays back.

Vizard reads no text files: what is published is Basilisk's `vizMessage.proto`, and its recordings are messages `VizMessage`,
each after its length (protocol buffers, "delimited"). Numbers of fields below are that file's; positions are relative to the
body in EME2000 [m], attitudes MRP relative to it.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable

import numpy as np

from swarm_mj.interop.states import FlightStates
from swarm_mj.spacecraft.attitude.mrp import mrp_from_quaternion
from swarm_mj.tracks.frames import C_EN
from swarm_mj.tracks.times import utc_of

#: Fields of VizMessage.
TIME, CELESTIAL_BODIES, SPACECRAFT, CAMERAS, EPOCH = 1, 2, 3, 4, 8
#: Nanoseconds in a second: times of the simulation are in these.
NANO = 1e9


def write_recording(states: FlightStates) -> bytes:
    """The recording: one message a sample."""
    environment = states.plan.environment
    sigma = mrp_from_quaternion(states.q_BE)
    C_AE = [environment.C_AN(float(t)) @ C_EN.T for t in states.times]
    out = bytearray()
    for k, t in enumerate(states.times.tolist()):
        first = k == 0
        message = _message(TIME, _whole(1, k) + _double(2, t * NANO))
        message += _message(CELESTIAL_BODIES, _body(states, C_AE[k], first))
        message += _message(CELESTIAL_BODIES, _sun(C_EN @ environment.sun.at(t), C_EN @ environment.sun.velocity))
        for j, name in enumerate(states.names):
            state = states.states_E[k, j]
            craft = _text(1, name) + _doubles(2, state[:3]) + _doubles(3, state[3:]) + _doubles(4, sigma[k, j])
            message += _message(SPACECRAFT, craft + (_text(13, "3USat") if first else b""))
        if first:
            message += b"".join(_message(CAMERAS, _camera(states, j)) for j in range(states.n))
            message += _message(EPOCH, _epoch(states))
        out += _length(len(message)) + message
    return bytes(out)


def _body(states: FlightStates, C_AE: np.ndarray, first: bool) -> bytes:
    out = _text(1, states.body.name.lower()) + _doubles(2, np.zeros(3)) + _doubles(3, np.zeros(3))
    out += _doubles(4, C_AE.ravel())
    if first:
        extent = np.ptp(states.plan.shape.vertices, axis=0) / 2.0
        gm = getattr(states.plan.environment.gravity, "gm", 0.0)
        out += _double(5, float(gm) / 1e9) + _double(6, float(extent[:2].max()) / 1e3)
        out += _double(7, float(extent[2] / extent[:2].max()))
    return out


def _sun(position: np.ndarray, velocity: np.ndarray) -> bytes:
    return _text(1, "sun") + _doubles(2, position) + _doubles(3, velocity) + _doubles(4, np.eye(3).ravel())


def _camera(states: FlightStates, j: int) -> bytes:
    camera = states.camera
    resolution = _packed(4, b"".join(_varint(camera.resolution_px) for _ in range(2)))
    # A rotation of nothing: the camera's frame is B, whose +z it looks along, as Vizard's cameras do.
    return (
        _whole(1, j + 1) + _text(2, states.names[j]) + _double(3, 2.0 * camera.half_angle_deg) + resolution
        + _doubles(7, np.zeros(3)) + _doubles(8, np.zeros(3))
    )  # fmt: skip


def _epoch(states: FlightStates) -> bytes:
    moment = utc_of(states.epoch)
    numbers = (moment.year, moment.month, moment.day, moment.hour, moment.minute)
    whole = b"".join(_whole(field, value) for field, value in enumerate(numbers, start=1))
    return whole + _double(6, moment.second + moment.microsecond / 1e6)


def _varint(value: int) -> bytes:
    """A whole number from 0 on, seven bits a byte."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


_length = _varint


def _key(field: int, wire: int) -> bytes:
    return _varint(field << 3 | wire)


def _whole(field: int, value: int) -> bytes:
    return _key(field, 0) + _varint(value)


def _double(field: int, value: float) -> bytes:
    return _key(field, 1) + struct.pack("<d", value)


def _packed(field: int, content: bytes) -> bytes:
    return _key(field, 2) + _varint(len(content)) + content


_message = _packed


def _text(field: int, text: str) -> bytes:
    return _packed(field, text.encode())


def _doubles(field: int, values: Iterable[float]) -> bytes:
    return _packed(field, b"".join(struct.pack("<d", float(value)) for value in values))
