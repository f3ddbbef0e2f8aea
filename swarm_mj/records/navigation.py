"""What linear covariance says of a plan's corrections, as rows, sentences and numbers for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from swarm_mj.flight.plan import Plan
from swarm_mj.flight.trajectory_corrections import CorrectionAnalysis, analyse_corrections
from swarm_mj.mission.covariance import arrival_axes, draw_linear, length_mean, length_quantile, length_within
from swarm_mj.scenarios.constants import STANDARD_GRAVITY
from swarm_mj.scenarios.itinerary import itinerary
from swarm_mj.scenarios.schema_propulsion import Thrusters
from swarm_mj.typing import Array

#: Chance with which limits and tanks are said to be enough.
SURE = 0.99
#: Linear flights that are drawn for what is not normal (after a burn that errs) and for sums of burns; their 99th percentile is
#: right to about 1 %.
DRAWS = 20_000
#: What six nozzles take at most beside those along the force: three of them share an oblique one.
OBLIQUE = 3.0**0.5
#: A correction is worth its gas where it takes away at least this share of the spread at the arrival.
WORTH = 0.05

Row = dict[str, Any]
#: Vectors that were drawn, shape (draws, 3); None: they are normal, and quadrature serves.
Drawn = Array | None


def navigation_rows(found: CorrectionAnalysis) -> list[Row]:
    """One row for each spacecraft and number of corrections flown, 0 to m: the spread at the arrival and the last burn."""
    legs = found.legs
    axes = arrival_axes(legs.r_N[:, -1], legs.v_N[:, -1])
    rows = []
    for j in range(found.plan.n):
        position, delta_v = _drawn(found, j)
        rows += [
            {
                "spacecraft": found.plan.names[j],
                "corrections": k,
                "time_s": None if k == 0 else float(legs.times[j, k]),
                **_at_arrival(found.spread.at_arrival[k, j, :3, :3], axes[j], position[k]),
                **_burnt(found, j, k, delta_v),
                **_seen(found, j, k, position[k]),
            }
            for k in range(legs.n_corrections + 1)
        ]
    return rows


def _drawn(found: CorrectionAnalysis, j: int) -> tuple[list[Drawn], list[Drawn]]:
    """Linear flights of spacecraft j, None for what is normal: `draw_linear`'s positions and burns, drawn where burns err."""
    m, errors = found.legs.n_corrections, found.errors
    if not m or not (errors.magnitude or errors.pointing):
        return [None] * (m + 1), [None] * m
    # A generator of its own, the same for all: the largest of several like percentiles is then no larger by chance.
    position, delta_v = draw_linear(found.legs, errors, j, draws=DRAWS, rng=np.random.default_rng(0))
    return [None, *position[1:]], [None, *delta_v[1:]]


def _mean(covariance: Array, drawn: Drawn) -> float:
    return length_mean(covariance) if drawn is None else float(np.linalg.norm(drawn, axis=1).mean())


def _sure(covariance: Array, drawn: Drawn) -> float:
    """Length that is not exceeded with the chance `SURE`."""
    return length_quantile(covariance, SURE) if drawn is None else _quantile(np.linalg.norm(drawn, axis=1))


def _quantile(values: Array) -> float:
    return float(np.quantile(values, SURE))


def _at_arrival(position: Array, axes: Array, drawn: Drawn) -> Row:
    # Rounding takes what a correction by exact knowledge leaves to either side of zero.
    sigma = np.sqrt(np.diag(axes @ position @ axes.T).clip(0.0))
    return {
        "position_3_sigma_m": 3.0 * float(np.sqrt(np.linalg.eigvalsh(position)[-1].clip(0.0))),
        "position_99_m": _sure(position, drawn),
        **{f"sigma_{name}_m": float(value) for name, value in zip("RTS", sigma, strict=True)},
    }


def _burnt(found: CorrectionAnalysis, j: int, k: int, drawn: list[Drawn]) -> Row:
    if k == 0:
        return {"delta_v_mean_m_s": 0.0, "delta_v_99_m_s": 0.0}
    covariance = found.spread.delta_v[k - 1, j]
    return {"delta_v_mean_m_s": _mean(covariance, drawn[k - 1]), "delta_v_99_m_s": _sure(covariance, drawn[k - 1])}


def _seen(found: CorrectionAnalysis, j: int, k: int, drawn: Drawn) -> Row:
    """Where the ground under the visiting point is in a camera that is pointed as planned, at a place that is not."""
    plan = found.plan
    if j >= plan.n_observers:
        return {"offset_99_deg": None, "in_camera_percent": None}
    altitude, half_angle = itinerary(plan.scenario)[j].altitude_m, np.radians(plan.scenario.camera.half_angle_deg)
    r_N = found.legs.r_N[j, -1]
    across = np.linalg.svd(r_N[None])[2][1:]
    covariance = across @ found.spread.at_arrival[k, j, :3, :3] @ across.T
    aside, wide = None if drawn is None else drawn @ across.T, altitude * float(np.tan(half_angle))
    within = length_within(covariance, wide) if aside is None else np.mean(np.linalg.norm(aside, axis=1) <= wide)
    return {
        "offset_99_deg": float(np.degrees(np.arctan(_sure(covariance, aside) / altitude))),
        "in_camera_percent": 100.0 * float(within),
    }


def total_delta_v(found: CorrectionAnalysis) -> dict[str, tuple[float, float]]:
    """Mean and 99th percentile of each spacecraft's burns together [m/s]: of one burn by quadrature, of several by drawing."""
    m, totals = found.legs.n_corrections, {}
    for j, name in enumerate(found.plan.names):
        if m <= 1:
            row = _burnt(found, j, m, [None])
            totals[name] = row["delta_v_mean_m_s"], row["delta_v_99_m_s"]
        else:
            _, delta_v = draw_linear(found.legs, found.errors, j, draws=DRAWS, rng=np.random.default_rng(0))
            size = np.linalg.norm(delta_v, axis=2).sum(axis=0)
            totals[name] = float(size.mean()), _quantile(size)
    return totals


def propellant_kg(thrusters: Thrusters, mass: float, delta_v: float) -> float:
    """What a change of velocity [m/s] of so large a mass takes from the tank at most, by the rocket equation [kg]."""
    exhaust = STANDARD_GRAVITY * thrusters.specific_impulse_s / (OBLIQUE if thrusters.layout == "six" else 1.0)
    return float(-mass * np.expm1(-delta_v / exhaust))


def navigation_findings(found: CorrectionAnalysis) -> list[str]:
    """One sentence on each stage of the way, on tanks and burns that are not enough, and on corrections that do not pay."""
    rows, names = navigation_rows(found), found.plan.names
    m = found.legs.n_corrections
    if not found.spread.at_arrival.any():
        return [
            *_by_pictures(found),
            "nothing is said to err, so no path spreads: give dispersions.deployment_velocity_m_s, mothership_position_m, "
            "mothership_velocity_m_s, or navigation and burn errors with corrections",
        ]
    stages = [[row for row in rows if row["corrections"] == k] for k in range(m + 1)]
    said = [_stage(k, stage) for k, stage in enumerate(stages)]
    said += [_useless(k, stages) for k in range(1, m + 1)]
    said += _by_pictures(found)
    return [words for words in [*said, *_tank(found, names), *_too_long(found, names, rows)] if words]


def _stage(k: int, rows: list[Row]) -> str:
    worst = max(rows, key=lambda row: row["position_3_sigma_m"])
    words = f"3 sigma {worst['position_3_sigma_m']:.3g} m at the arrival ({worst['spacecraft']}, the widest)"
    if k == 0:
        return f"without corrections: {words}"
    return f"after correction {k}: {words}, {max(row['delta_v_99_m_s'] for row in rows):.3g} m/s (99 %)"


def _useless(k: int, stages: list[list[Row]]) -> str:
    before, after = (max(row["position_3_sigma_m"] for row in stages[i]) for i in (k - 1, k))
    if after <= (1.0 - WORTH) * before:
        return ""
    return (
        f"correction {k} does not pay: it leaves 3 sigma {after:.3g} m of {before:.3g} m, for the errors of navigation and "
        "burns are as large; leave it out, fly it later (trajectory.corrections), or navigate better (navigation)"
    )


def known_3_sigma(found: CorrectionAnalysis) -> dict[str, float] | None:
    """What each spacecraft knows of its position at the arrival by pictures, 3 sigma, widest axis [m]; None: there are none."""
    if found.known is None:
        return None
    widest = np.linalg.eigvalsh(found.known[:, :3, :3])[:, -1].clip(0.0)
    return {name: 3.0 * float(np.sqrt(value)) for name, value in zip(found.plan.names, widest, strict=True)}


def _by_pictures(found: CorrectionAnalysis) -> list[str]:
    """What pictures tell on the way; nothing where none are taken."""
    known = known_3_sigma(found)
    if known is None:
        return []
    told = "; ".join(
        f"{name}: {', '.join(f'{count} by {way}' for way, count in ways.items()) or _why_none(untold)}, known to "
        f"{known[name]:.3g} m"
        for name, ways, untold in zip(found.plan.names, found.pictures, found.untold, strict=True)
    )
    found_by = [f"pictures on the way that tell something, and 3 sigma of the position at the arrival by them: {told}"]
    if found.plan.scenario.navigation.optical.range_m is not None:
        found_by.append("ranges between spacecraft (navigation.optical.range_m) are left out here; flights use them")
    return found_by


def _why_none(untold: dict[str, int]) -> str:
    """Why none of a spacecraft's pictures told anything."""
    if not untold:
        return "none, it takes no pictures"
    why = max(untold, key=untold.__getitem__)
    return f"none of {sum(untold.values())}, {untold[why]} for {why}"


def _tank(found: CorrectionAnalysis, names: tuple[str, ...]) -> list[str]:
    thrusters, mass = found.plan.scenario.spacecraft.thrusters, found.plan.properties.mass
    if thrusters is None:
        return []
    needed = {name: propellant_kg(thrusters, mass, of[1]) for name, of in total_delta_v(found).items()}
    short = [name for name in names if needed[name] > thrusters.propellant_kg]
    if not short:
        return []
    most = max(needed.values())
    return [
        f"the tank may not do for the corrections of {', '.join(short)}: at 99 % they burn up to {most:.3g} kg, "
        f"spacecraft.thrusters.propellant_kg = {thrusters.propellant_kg:g}; carry more, or correct earlier"
    ]


def _too_long(found: CorrectionAnalysis, names: tuple[str, ...], rows: list[Row]) -> list[str]:
    """Burns that at 99 % do not end before the next correction or the arrival; a nozzle's thrust is the least of the forces."""
    thrusters, times = found.plan.scenario.spacecraft.thrusters, found.legs.times
    if thrusters is None:
        return []
    said = []
    for k in range(found.legs.n_corrections):
        lasts = np.array([row["delta_v_99_m_s"] for row in rows if row["corrections"] == k + 1])
        lasts *= found.plan.properties.mass / thrusters.thrust_n
        room = times[:, k + 2] - times[:, k + 1]
        if (lasts > room).any():
            j = int(np.argmax(lasts - room))
            said.append(
                f"correction {k + 1} of {names[j]} may burn for {lasts[j]:.3g} s at 99 %, longer than the {room[j]:g} s to the "
                "next correction or the arrival; correct earlier, or raise spacecraft.thrusters.thrust_n"
            )
    return said


def navigation_summary(plan: Plan) -> Row:
    """For summary.json where there are corrections: the spread before and after them, and what they are expected to burn.

    Nothing where they go by pictures, of which it knows nothing.
    """
    if not plan.scenario.trajectory.corrections or plan.scenario.navigation.mode == "optical":
        return {}
    found = analyse_corrections(plan)
    rows, totals = navigation_rows(found), total_delta_v(found)
    last = found.legs.n_corrections
    return {
        "navigation": {
            "position_3_sigma_m_uncorrected": _of(rows, 0),
            "position_3_sigma_m": _of(rows, last),
            "delta_v_mean_m_s": {name: round(of[0], 6) for name, of in totals.items()},
            "delta_v_99_m_s": {name: round(of[1], 6) for name, of in totals.items()},
            "findings": navigation_findings(found),
        }
    }


def _of(rows: list[Row], k: int) -> dict[str, float]:
    return {row["spacecraft"]: round(row["position_3_sigma_m"], 6) for row in rows if row["corrections"] == k}
