"""MJCF files of spacecraft, put together from parts: a hub of 7.61 kg with three wheels, and what a test hangs on it."""

WHEEL = """
<body name="{name}" pos="{place}"><joint name="{name}" axis="{axis}"/>
  <inertial pos="0 0 0" mass="0.13" fullinertia="{inertia}"/></body>"""
MOTOR = '<motor name="{name}" joint="{name}" ctrlrange="-0.004 0.004"/>'
SPIN, TRANSVERSE = 2.387e-5, 1.545e-5
ORTHOGONAL = {"wheel_x": (1.0, 0.0, 0.0), "wheel_y": (0.0, 1.0, 0.0), "wheel_z": (0.0, 0.0, 1.0)}


def wheel(name, axis, z=0.0):
    """A balanced disc on a hinge."""
    length = sum(a * a for a in axis) ** 0.5
    unit = [a / length for a in axis]
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    inertia = [TRANSVERSE * (i == j) + (SPIN - TRANSVERSE) * unit[i] * unit[j] for i, j in pairs]
    words = {"name": name, "place": f"0 0 {z}", "axis": " ".join(map(str, axis))}
    return WHEEL.format(**words, inertia=" ".join(f"{x:.12g}" for x in inertia))


def mjcf(on_hub="", *, wheels=None, motors=None, beside="", sensors="", option="", rest="", hub=None):
    """A spacecraft's file.

    Args:
        on_hub: Bodies, geoms and sites inside the hub.
        wheels: Axes by name; None: x, y, z, a third below, at and above the middle.
        motors: The actuators; None: a motor for each wheel.
        beside: What stands beside the hub.
        sensors: Inside <sensor>.
        option: Inside the root, before the bodies.
        rest: Inside the root, at the end.
        hub: The hub's inertial element; None: that of the packaged CubeSat.
    """
    wheels = ORTHOGONAL if wheels is None else wheels
    places = [0.05 * (2 * k / max(1, len(wheels) - 1) - 1) for k in range(len(wheels))]
    turning = "".join(wheel(name, axis, z) for (name, axis), z in zip(wheels.items(), places, strict=True))
    motors = "".join(MOTOR.format(name=name) for name in wheels) if motors is None else motors
    inertial = (
        hub or '<inertial pos="0 0 0" mass="7.61" diaginertia="0.0830285633333 0.0830285633333 0.0132785633333"/>'
    )
    return f"""<mujoco model="own">
  <compiler autolimits="true" angle="radian"/>
  {option}
  <worldbody>
    <body name="hub"><freejoint name="free"/>{inertial}
      <site name="imu"/>{turning}{on_hub}
    </body>{beside}
  </worldbody>
  <actuator>{motors}</actuator>
  <sensor>{sensors}</sensor>
  {rest}
</mujoco>
"""
