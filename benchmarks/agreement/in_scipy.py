"""The flight by SciPy, the third party: DOP853 at a tolerance of 1e-13, gravity in closed form, equations written anew."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.agreement.coefficients import unnormalised
from benchmarks.agreement.job import Job, work

Array = NDArray[np.float64]


def turn(axis: int, angle: float) -> Array:
    """Rotation of the frame about one of its axes 1, 2, 3, shape (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = axis % 3, (axis + 1) % 3
    out = np.eye(3)
    out[i, i], out[i, j], out[j, i], out[j, j] = c, s, -s, c
    return out


def body_attitude(angles: tuple[float, float, float, float], t: float) -> Array:
    """C_AE by the angles of the IAU (Archinal et al. 2018): node at 90 deg + right ascension, then tilt, then W."""
    ra, dec, w, rate = angles
    return turn(3, w + rate * t) @ turn(1, np.pi / 2 - dec) @ turn(3, np.pi / 2 + ra)


def degree_2_form(terms: list[Any]) -> Array:
    """Matrix Q with U = GM/r + GM R^2 (r.Q.r) / r^5, of a field of degree 2 without degree 1, shape (3, 3)."""
    if any(n == 1 and (c or s) for n, _, c, s in terms) or max(n for n, *_ in terms) > 2:
        raise ValueError("the closed form has degrees 0 and 2 only")
    (_, _, c20, _), (_, _, c21, s21), (_, _, c22, s22) = (t for t in unnormalised(terms) if t[0] == 2)
    # Solid harmonics: z^2 - (x^2 + y^2)/2; 3 x z, 3 y z; 3 (x^2 - y^2), 6 x y (Montenbruck and Gill 2000, table 3.1).
    return np.array(
        [
            [-0.5 * c20 + 3 * c22, 3 * s22, 1.5 * c21],
            [3 * s22, -0.5 * c20 - 3 * c22, 1.5 * s21],
            [1.5 * c21, 1.5 * s21, c20],
        ]
    )


def attraction(job: Job, r_A: Array) -> Array:
    """In A [m/s^2], shape (..., 3)."""
    gm, radius = job.facts["gm"], job.facts["radius"]
    r = np.linalg.norm(r_A, axis=-1, keepdims=True)
    total = -gm * r_A / r**3
    if job.facts["terms"]:
        turned = r_A @ degree_2_form(job.facts["terms"])
        along = np.sum(r_A * turned, axis=-1, keepdims=True)
        total = total + gm * radius**2 * (2 * turned / r**5 - 5 * along * r_A / r**7)
    return np.asarray(total)


def paths(job: Job) -> Array:
    """States in E, shape (t, n, 6)."""
    angles, times, starts = job.angles("exported"), job.asked["times"], job.asked["start_E"]

    def rates(t: float, y: Array) -> Array:
        state = y.reshape(-1, 6)
        C_AE = body_attitude(angles, t)
        return np.hstack([state[:, 3:], attraction(job, state[:, :3] @ C_AE.T) @ C_AE]).ravel()

    end = solve_ivp(rates, (0.0, times[-1]), starts.ravel(), "DOP853", times, rtol=1e-13, atol=1e-9, max_step=100.0)
    return np.asarray(end.y.T.reshape(len(times), -1, 6))


def attitude(job: Job) -> tuple[Array, Array]:
    """Quaternions (w, x, y, z) of B relative to N and wheel speeds [rad/s] under the torques of the flight, (t, 4), (t, 3)."""
    wheels, torques, period = job.facts["wheels"], job.asked["torques"], job.facts["wheels"]["period_s"]
    spin, axes = wheels["spin_inertia"], np.array(wheels["axes_B"])
    # By momentum: each wheel's absolute momentum h changes by its motor's torque alone.
    inertia = np.array(wheels["inertia_B"]) - spin * axes.T @ axes
    inverse = np.linalg.inv(inertia)
    q, omega = job.asked["q0"], job.asked["omega0"]
    y = np.concatenate([q, omega, spin * (job.asked["wheel_speed0"] + axes @ omega)])
    states = [y]
    for u in torques[:-1]:

        def rates(t: float, y: Array, u: Array = u) -> Array:
            q, w, h = y[:4], y[4:7], y[7:]
            dq = 0.5 * np.concatenate([[-q[1:] @ w], q[0] * w + np.cross(q[1:], w)])
            dw = inverse @ (-np.cross(w, inertia @ w + axes.T @ h) - axes.T @ u)
            return np.concatenate([dq, dw, u])

        y = solve_ivp(rates, (0.0, period), y, "DOP853", rtol=1e-12, atol=1e-13, first_step=period / 2).y[:, -1]
        y[:4] /= np.linalg.norm(y[:4])
        states.append(y)
    flown = np.array(states)
    return flown[:, :4], flown[:, 7:] / spin - flown[:, 4:7] @ axes.T


def compute(job: Job) -> dict[str, Any]:
    """All that is asked."""
    out: dict[str, Any] = {"path": paths(job)}
    for which in ("exported", "published"):
        out[f"C_AE_{which}"] = [body_attitude(job.angles(which), t) for t in job.asked["turn_times"]]
    if "wheels" in job.facts:
        out["q_BN"], out["wheel_speed"] = attitude(job)
    return out


if __name__ == "__main__":
    work("scipy", compute)
