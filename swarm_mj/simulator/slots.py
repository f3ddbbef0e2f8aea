"""Names for the rows and columns of the arrays that a flight's decisions share."""

from __future__ import annotations

from enum import IntEnum


class Slot(IntEnum):
    """Rows of the loop's work array, each (n, 3)."""

    R = 0  #: position in N [m]
    V = 1  #: velocity in N [m/s]
    OMEGA = 2  #: body rate in B [rad/s]
    SIGMA_BR = 3  #: attitude error
    WHEEL = 4  #: wheel speeds relative to the hub [rad/s]
    LOS = 5  #: unit line of sight in N
    A = 6  #: acceleration in N [m/s^2]
    R_A = 7  #: position in A at the middle of the hold [m]
    MOMENTUM = 8  #: wheel momentum relative to the hub in B [kg m^2/s]
    RHO = 9  #: target minus spacecraft in N [m]
    RHO_DOT = 10
    RHO_DDOT = 11
    OMEGA_R = 12  #: reference rate in N [rad/s]
    DOMEGA_R = 13  #: its derivative in N [rad/s^2]
    OMEGA_BR = 14  #: rate error in B [rad/s]
    OMEGA_R_B = 15  #: reference rate in B [rad/s]
    DOMEGA_R_B = 16  #: its inertial derivative in B [rad/s^2]


class Peak(IntEnum):
    """Columns of the peaks of a flight, each over all control periods so far, shape (n, 3)."""

    WHEEL_SPEED = 0  #: largest speed of a wheel [rad/s]
    MOTOR_TORQUE = 1  #: largest motor torque [N m]
    CUT_HOLDS = 2  #: holds in which a limit cut a torque


class Resting(IntEnum):
    """Whether the flight of a spacecraft is over."""

    FLYING = 0
    ON_THE_BODY = 1  #: it hit the body and turns with it
    HELD = 2  #: it diverged, and is held where it was
