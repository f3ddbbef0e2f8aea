"""Releases beyond the deployer's speed that no insertion burn makes up for, and what would do, found by planning it."""

from __future__ import annotations

from datetime import datetime, timedelta
from math import ceil, inf, sqrt
from typing import Any

from swarm_mj.errors import SwarmError
from swarm_mj.flight.burns import other_burns, push_of
from swarm_mj.flight.plan import Plan, make_plan
from swarm_mj.mission.deployer import ROUNDING, beyond
from swarm_mj.mission.finite_burns import propellant_for
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema_propulsion import Thrusters

#: Times of flight that are tried, and by how much each is longer than the straight line says.
TRIES, MARGIN = 4, 1.01
#: What a burn is said to need over what it needs by the straight line.
RESERVE = 1.1


def release_findings(plan: Plan) -> list[str]:
    """One sentence on who leaves faster than the deployer can push, with what would do; nothing where nobody does."""
    most, speed = plan.scenario.mothership.deployer.max_speed_m_s, plan.deployment.delta_v
    fast = beyond(plan.deployment, most)
    if most is None or not fast.any():
        return []
    longer, burning = _longer(plan, most), _burning(plan, most)
    remedies = [
        f"begin earlier and fly longer ({_words(longer)})" if longer else "",
        f"fly insertion burns ({_words(burning)})" if burning else "",
        f"leave out {busy}, beside which no insertion burns are flown" if (busy := other_burns(plan.scenario)) else "",
        "give the speed of your deployer",
    ]
    return [
        f"{fast.sum()} of {plan.n} spacecraft leave at up to {speed.max():.3g} m/s ({plan.names[int(speed.argmax())]}), beyond "
        f"mothership.deployer.max_speed_m_s = {most:g}, and are flown as if it could: {', or '.join(filter(None, remedies))}"
    ]


def _words(overrides: dict[str, Any]) -> str:
    return ", ".join(
        f"{key} = {value:g}" if isinstance(value, float) else f"{key} = {value}" for key, value in overrides.items()
    )


def _fastest(plan: Plan, overrides: dict[str, Any]) -> float:
    """Largest deployment speed of a changed scenario [m/s]; infinity where it cannot be planned."""
    try:
        changed = make_plan(load_scenario(plan.scenario, overrides), check_separation=False)
    except SwarmError:
        return inf
    return float(changed.deployment.delta_v.max())


def _longer(plan: Plan, most: float) -> dict[str, Any] | None:
    """Longer flights from an earlier epoch to arrivals at the same instants; None: none of those tried would do."""
    factor, fastest = 1.0, float(plan.deployment.delta_v.max())
    while_s = float((plan.deployment.arrival_s - plan.deployment.release_s).max())
    for _ in range(TRIES):
        # On a straight line the speed off the mothership's path falls as the time grows.
        factor *= MARGIN * fastest / most
        overrides = _earlier(plan, (factor - 1.0) * while_s)
        fastest = inf if overrides is None else _fastest(plan, overrides)
        if fastest <= most or fastest == inf:
            break
    return overrides if fastest <= most else None


def _earlier(plan: Plan, more_s: float) -> dict[str, Any] | None:
    """Epoch and releases so much earlier, on the same path of the mothership as far as it has one; None: not to be had."""
    scenario, mothership = plan.scenario, plan.scenario.mothership
    if scenario.design.observers or mothership.elements is not None:
        return None
    more = scenario.telemetry.interval_s * ceil(more_s / scenario.telemetry.interval_s)
    overrides: dict[str, Any] = {
        "design.time_of_flight_s": scenario.design.time_of_flight_s + more,
        "duration_s": scenario.duration_s + more,
        "epoch": (datetime.fromisoformat(scenario.epoch) - timedelta(seconds=more)).isoformat(),
    }
    if mothership.approach is not None:
        if mothership.approach.closest_approach_s is not None:
            overrides["mothership.approach.closest_approach_s"] = mothership.approach.closest_approach_s + more
    elif not isinstance(mothership.velocity, str) and mothership.ephemeris is None:
        before_N = plan.deployment.r0_N - more * plan.deployment.mothership_velocity_N
        overrides["mothership.position_A_m"] = (plan.environment.C_AN(-more) @ before_N).round().tolist()
    return overrides


def _burning(plan: Plan, most: float) -> dict[str, Any] | None:
    """Thrusters that give what is missing in half of the time that is left; None: they would not do."""
    deployment, delay = plan.deployment, plan.scenario.mothership.deployer.insertion_after_s
    flight = deployment.arrival_s - deployment.release_s
    left = flight - delay
    if other_burns(plan.scenario) or left.min() <= 0.0:
        return None
    # In the middle of such a burn three quarters of what is left are still to come.
    delta_v = RESERVE * float(((deployment.delta_v - most).clip(0.0) * flight / (0.75 * left)).max())
    has, push, mass = plan.scenario.spacecraft.thrusters, push_of(plan.properties, plan.own), plan.properties.mass
    thrusters = has or Thrusters()
    strength = 1.0 if has is None or push is None else push.force / has.thrust_n
    # Six nozzles that share an oblique force take up to sqrt(3) times as much propellant.
    need = (
        mass * delta_v / (0.5 * left.min() * strength),
        sqrt(3.0) * propellant_for(delta_v, mass, thrusters.exhaust_speed),
    )
    keys = "thrust_n", "propellant_kg"
    asked = {key: max(float(f"{value:.2g}"), getattr(thrusters, key)) for key, value in zip(keys, need, strict=True)}
    if _fastest(plan, {"spacecraft.thrusters": {**thrusters.model_dump(), **asked}}) > most * (1.0 + ROUNDING):
        return None
    return {f"spacecraft.thrusters.{key}": value for key, value in asked.items()}
