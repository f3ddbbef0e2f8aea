"""What the sensors of a MuJoCo model measure: unit, frame and words by their type.

The types are those of MuJoCo 4 (XML reference, element `sensor`). What MuJoCo calls an accelerometer gives the acceleration of
its site less the model's uniform gravity, which is zero here: the pull of the small body is applied as a force, and MuJoCo
cannot tell it from a push. A real accelerometer does not feel it, so the loop takes it away (`instruments`).
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco

from swarm_mj.spacecraft.elements import joint_kind, name_of

_S = mujoco.mjtSensor
_SITE = "of the site, in its own axes"

#: Unit and words of each type of sensor; a unit of None depends on the joint.
_MEANING: dict[int, tuple[str | None, str]] = {
    _S.mjSENS_TOUCH: ("N", "sum of the contact forces inside the site"),
    _S.mjSENS_ACCELEROMETER: ("m s-2", f"specific force: acceleration {_SITE}, less that of gravity"),
    _S.mjSENS_VELOCIMETER: ("m s-1", f"velocity relative to N {_SITE}"),
    _S.mjSENS_GYRO: ("rad s-1", f"angular velocity relative to N {_SITE}"),
    _S.mjSENS_FORCE: ("N", "force from the body on its parent through the joint, in the site's axes"),
    _S.mjSENS_TORQUE: ("N m", "torque from the body on its parent through the joint, in the site's axes"),
    _S.mjSENS_MAGNETOMETER: ("T", "magnetic field of the model's options, in the site's axes"),
    _S.mjSENS_RANGEFINDER: ("m", "distance along the site's z axis to the nearest surface; -1: none"),
    _S.mjSENS_CAMPROJECTION: ("1", "pixel coordinates of a site in a camera's image"),
    _S.mjSENS_JOINTPOS: (None, "position of the joint"),
    _S.mjSENS_JOINTVEL: (None, "velocity of the joint"),
    _S.mjSENS_TENDONPOS: ("m", "length of the tendon"),
    _S.mjSENS_TENDONVEL: ("m s-1", "rate of the tendon's length"),
    _S.mjSENS_ACTUATORPOS: (None, "length of the actuator"),
    _S.mjSENS_ACTUATORVEL: (None, "rate of the actuator's length"),
    _S.mjSENS_ACTUATORFRC: (None, "force of the actuator"),
    _S.mjSENS_JOINTACTFRC: (None, "force of all actuators on the joint"),
    _S.mjSENS_TENDONACTFRC: ("N", "force of all actuators on the tendon"),
    _S.mjSENS_BALLQUAT: ("1", "rotation of the ball joint, quaternion w x y z"),
    _S.mjSENS_BALLANGVEL: ("rad s-1", "angular velocity of the ball joint"),
    _S.mjSENS_JOINTLIMITPOS: (None, "how far the joint is from its limit"),
    _S.mjSENS_JOINTLIMITVEL: (None, "velocity of the joint at its limit"),
    _S.mjSENS_JOINTLIMITFRC: (None, "force of the joint's limit"),
    _S.mjSENS_TENDONLIMITPOS: ("m", "how far the tendon is from its limit"),
    _S.mjSENS_TENDONLIMITVEL: ("m s-1", "velocity of the tendon at its limit"),
    _S.mjSENS_TENDONLIMITFRC: ("N", "force of the tendon's limit"),
    _S.mjSENS_FRAMEPOS: ("m", "position"),
    _S.mjSENS_FRAMEQUAT: ("1", "attitude, quaternion w x y z"),
    _S.mjSENS_FRAMEXAXIS: ("1", "x axis"),
    _S.mjSENS_FRAMEYAXIS: ("1", "y axis"),
    _S.mjSENS_FRAMEZAXIS: ("1", "z axis"),
    _S.mjSENS_FRAMELINVEL: ("m s-1", "velocity"),
    _S.mjSENS_FRAMEANGVEL: ("rad s-1", "angular velocity"),
    _S.mjSENS_FRAMELINACC: ("m s-2", "acceleration, that of gravity included"),
    _S.mjSENS_FRAMEANGACC: ("rad s-2", "angular acceleration"),
    _S.mjSENS_SUBTREECOM: ("m", "centre of mass of the body and what hangs on it"),
    _S.mjSENS_SUBTREELINVEL: ("m s-1", "velocity of the centre of mass of the body and what hangs on it"),
    _S.mjSENS_SUBTREEANGMOM: (
        "kg m2 s-1",
        "angular momentum of the body and what hangs on it about their centre of mass",
    ),
    _S.mjSENS_INSIDESITE: ("1", "1 where the object is inside the site"),
    _S.mjSENS_GEOMDIST: ("m", "distance between two geoms"),
    _S.mjSENS_GEOMNORMAL: ("1", "direction from one geom to another"),
    _S.mjSENS_GEOMFROMTO: ("m", "nearest points of two geoms"),
    _S.mjSENS_E_POTENTIAL: ("J", "potential energy of springs, of the whole swarm"),
    _S.mjSENS_E_KINETIC: ("J", "kinetic energy of the whole swarm"),
    _S.mjSENS_CLOCK: ("s", "time of the simulation"),
}
#: Units of what depends on a joint: what turns and what slides.
_BY_JOINT = {
    _S.mjSENS_JOINTPOS: ("rad", "m"),
    _S.mjSENS_JOINTVEL: ("rad s-1", "m s-1"),
    _S.mjSENS_ACTUATORPOS: ("rad", "m"),
    _S.mjSENS_ACTUATORVEL: ("rad s-1", "m s-1"),
    _S.mjSENS_ACTUATORFRC: ("N m", "N"),
    _S.mjSENS_JOINTACTFRC: ("N m", "N"),
    _S.mjSENS_JOINTLIMITPOS: ("rad", "m"),
    _S.mjSENS_JOINTLIMITVEL: ("rad s-1", "m s-1"),
    _S.mjSENS_JOINTLIMITFRC: ("N m", "N"),
}
_IN_SITE_AXES = {
    _S.mjSENS_ACCELEROMETER,
    _S.mjSENS_VELOCIMETER,
    _S.mjSENS_GYRO,
    _S.mjSENS_FORCE,
    _S.mjSENS_TORQUE,
    _S.mjSENS_MAGNETOMETER,
}
_OF_A_FRAME = range(int(_S.mjSENS_FRAMEPOS), int(_S.mjSENS_FRAMEANGACC) + 1)
_IN_N = {
    _S.mjSENS_SUBTREECOM,
    _S.mjSENS_SUBTREELINVEL,
    _S.mjSENS_SUBTREEANGMOM,
    _S.mjSENS_GEOMNORMAL,
    _S.mjSENS_GEOMFROMTO,
}


class Sensor(NamedTuple):
    """One sensor of a spacecraft."""

    name: str  #: in the file
    size: int  #: how many numbers it gives
    units: str  #: of them
    frame: str  #: in which they are
    long_name: str  #: what they are
    site: str = ""  #: of an accelerometer, whose reading is corrected for gravity; else empty


def sensors_of(model: mujoco.MjModel) -> tuple[Sensor, ...]:
    """The sensors of a model, in its order."""
    return tuple(_sensor(model, i) for i in range(model.nsensor))


def _sensor(model: mujoco.MjModel, i: int) -> Sensor:
    kind = int(model.sensor_type[i])
    units, words = _MEANING.get(kind, ("unknown", f"reading of MuJoCo's {_S(kind).name}"))
    if units is None:
        units = _BY_JOINT[kind][_slides(model, i)]
    of = name_of_object(model, int(model.sensor_objtype[i]), int(model.sensor_objid[i]))
    accelerometer = kind == _S.mjSENS_ACCELEROMETER
    return Sensor(
        name=name_of(model, "sensor", i),
        size=int(model.sensor_dim[i]),
        units=units,
        frame=_frame(model, i, kind, of),
        long_name=f"{words} ({of})" if of else words,
        site=name_of(model, "site", int(model.sensor_objid[i])) if accelerometer else "",
    )


def _frame(model: mujoco.MjModel, i: int, kind: int, of: str) -> str:
    if kind in _IN_SITE_AXES:
        return of
    if kind in _OF_A_FRAME:
        return name_of_object(model, int(model.sensor_reftype[i]), int(model.sensor_refid[i])) or "N"
    return "N" if kind in _IN_N else "none"


def name_of_object(model: mujoco.MjModel, kind: int, i: int) -> str:
    """What a sensor is attached to, such as `site imu`; empty: nothing."""
    if i < 0 or kind in (int(mujoco.mjtObj.mjOBJ_UNKNOWN), -1):
        return ""
    word = mujoco.mjtObj(kind).name.removeprefix("mjOBJ_").lower()
    return f"{word} {mujoco.mj_id2name(model, kind, i) or i}"


def _slides(model: mujoco.MjModel, i: int) -> bool:
    """Whether the joint that a sensor is about slides rather than turns."""
    joint = int(model.sensor_objid[i])
    if model.sensor_objtype[i] == mujoco.mjtObj.mjOBJ_ACTUATOR:
        if model.actuator_trntype[joint] != mujoco.mjtTrn.mjTRN_JOINT:
            return True  # tendons, and whatever pulls along a line
        joint = int(model.actuator_trnid[joint, 0])
    return joint_kind(model, joint) == "slide"
