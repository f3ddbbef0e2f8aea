"""Write docs/how-to/corrections.md, what corrections of trajectories leave: python -m scripts.pages.corrections."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scripts.pages import ROOT
from swarm_mj.api.navigate import Navigation, navigate
from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.plan import Plan
from swarm_mj.io.atomic import write_text
from swarm_mj.mission.covariance import sample_chance
from swarm_mj.scenarios.loading import parse_overrides
from swarm_mj.typing import Array

PAGE = ROOT / "docs" / "how-to" / "corrections.md"
ERRORS = {
    "spacecraft.thrusters": {},
    "dispersions.deployment_velocity_m_s": 0.1,
    "dispersions.burn_magnitude_percent": 2,
    "dispersions.burn_pointing_deg": 1,
}
#: Name, what it knows of itself, corrections to choose from.
MISSIONS: tuple[tuple[str, tuple[float, float], tuple[str, ...]], ...] = (
    (
        "eros-config1",
        (5.0, 0.01),
        ("[{after_release_s: 60}]", "[{before_arrival_s: 120}]", "[{after_release_s: 60}, {before_arrival_s: 120}]"),
    ),
    (
        "bennu-slow",
        (2.0, 0.005),
        ("[{after_release_s: 60}]", "[{before_arrival_s: 120}]", "[{after_release_s: 60}, {before_arrival_s: 120}]"),
    ),
    (
        "fast-flyby",
        (50.0, 0.01),
        (
            "[{after_release_s: 3600}]",
            "[{before_arrival_s: 7200}]",
            "[{after_release_s: 3600}, {before_arrival_s: 7200}]",
        ),
    ),
)
RUNS, FLIGHTS = 1000, 20

TEXT = """# Corrections and dispersions

A spacecraft that leaves its deployer at a wrong velocity misses its visiting point by that velocity times the time of
flight. Cold-gas thrusters can correct that on the way. This page is written by `python -m scripts.pages.corrections`.

```yaml
name: my-flight                             # all else by default
spacecraft: {{thrusters: {{}}}}                # the defaults: 55 mN, 65 s, 0.2 kg of gas
trajectory:
  corrections:                              # of every spacecraft
    - {{after_release_s: 60}}
    - {{before_arrival_s: 120}}
navigation: {{position_m: 5, velocity_m_s: 0.01}}   # what a spacecraft knows of itself then, 1 sigma
dispersions:
  deployment_velocity_m_s: 0.1
  burn_magnitude_percent: 2                 # errors of the burns, 1 sigma
  burn_pointing_deg: 1
```

`dispersions.mothership_position_m` and `mothership_velocity_m_s` are errors that all spacecraft share. All errors are
normal, have mean zero and come from the scenario's seed. Times are whole multiples of `control.period_s`; a correction
lies between release and arrival.

## Before the flight: `swarm-mj navigate`

```sh
swarm-mj navigate my.yaml                 # a table of the arrival, from linear covariance, in seconds
swarm-mj navigate my.yaml --runs 1000     # checked by 1,000 flights under all forces
```

```python
found = sm.navigate("my.yaml", runs=1000)
found.table  # spread at the arrival, burns, camera: one row a spacecraft and number of corrections flown
found.covariance_N  # (corrections + 1, spacecraft, 3, 3); covariance_RTS: outward, across, along the flight
found.delta_v  # of all corrections together
found.agreement  # covariance and flights side by side
found.findings  # in sentences
```

With 0.1 m/s of the deployer, 2 % and 1 deg of the burns (of each scenario the spacecraft that is widest):

{missions}

The 3 sigma are along the longest axis of the ellipsoid. `99 %` of the burns together is of their sizes added up. Percentiles
of several burns together, and of all that follows a burn that errs, are drawn in 20,000 linear flights, right to about 1 %:
such an error is a product of two normal variables, whose tail is longer than a normal one's. *In camera* is the chance that
the ground under the visiting point is seen by a camera that points where the plan says, at a place that is not the planned
one; in flights spacecraft point from where they are. The circle inside the field of view counts.

An early correction is cheap, because a small change of velocity has long to act, but what it does not know of the velocity
has long to act as well. A late one alone is dear, and a large burn leaves large errors of its own. Two together take the
best of both. Where a correction leaves nearly as much as was there before, where 99 % need more gas than the tank
holds, or where a burn would last beyond the next correction, a finding says so.

## In flight

`swarm-mj fly` flies the corrections with the thrusters in MuJoCo. A burn begins at its time and lasts as long as the thrust
asks for: 0.2 m/s of 8 kg by 55 mN takes half a minute. Each control period asks for what, given at the middle of the rest of
the burn, takes away the rest of the miss. `summary.json` has the expected numbers under `navigation`; its findings are told
at the end of the run and in the report. A lost spacecraft, and one that stays in its deployer, burns nothing.

{flights}

## How it is computed

The state transition matrix Phi of each planned trajectory is integrated with it by DOP853, with the gradient of all forces
of the flight by central differences. At a correction at t_c, delta_v = -Phi_rv(t_v, t_c)^-1 [Phi_rr dr + Phi_rv dv] brings
the spacecraft to its point at its planned time t_v. The covariance P becomes (I + BK) P (I + BK)^T + B (K N K^T + Q) B^T with
the gain K, the navigation's covariance N and the burn's Q = s^2 S + a^2 (tr(S) I - S), where S is the covariance of the wished
burn, s its relative error of size and a that of direction. Means and percentiles of lengths of normal vectors come from
quadrature over directions.

{checks}

Along the longest axis of their own spread flights are some 5 % wider by chance alone, where three axes are alike and the widest
of several spacecraft is taken.
"""


def missions() -> tuple[str, list[Navigation]]:
    """The table of all missions and corrections, and those with two corrections, checked by flights."""
    lines = [
        "| scenario | knows [m, m/s] | corrections | 3 sigma at the arrival [m] | burns, mean and 99 % [m/s] | in camera [%] |",
        "|---|---|---|---|---|---|",
    ]
    checked = []
    for name, known, choices in MISSIONS:
        known_keys = {"navigation.position_m": known[0], "navigation.velocity_m_s": known[1]}
        for corrections in choices:
            last = corrections is choices[-1]
            overrides = {**ERRORS, **known_keys, **parse_overrides([f"trajectory.corrections={corrections}"])}
            found = navigate(name, overrides, runs=RUNS if last else 0)
            if corrections is choices[0]:
                lines.append(_row(name, known, "none", found, 0))
            lines.append(_row(name, known, corrections.strip("[]"), found, found.found.legs.n_corrections))
            checked += [found] if last else []
    return "\n".join(lines), checked


def _row(name: str, known: tuple[float, float], words: str, found: Navigation, k: int) -> str:
    rows = found.table.xs(k, level="corrections")
    worst = rows.loc[rows["position_3_sigma_m"].astype(float).idxmax()]
    burns = found.delta_v.max()
    burnt = f"{burns['mean_m_s']:.2g}, {burns['percentile_99_m_s']:.2g}" if k else "-"
    seen = rows["in_camera_percent"].astype(float).min()
    return f"| `{name}` | {known[0]:g}, {known[1]:g} | {words} | {worst['position_3_sigma_m']:.3g} | {burnt} | {seen:.1f} |"


def checks(found: Sequence[Navigation]) -> str:
    """What the Monte Carlo flights said."""
    words = (
        f"{RUNS:,} flights of each spacecraft under all forces, with impulsive burns, against linear covariance: 3 sigma of "
        "the spacecraft that is widest, both along the longest axis of its covariance, with the sampling error of so many "
        "flights (1 sigma); and by Nagao's test of the whole 3 x 3 matrix the chance of differing more, the least of all:"
    )
    lines = [
        textwrap.fill(words, 120),
        "",
        "| scenario | linear [m] | flown [m] | least chance |",
        "|---|---|---|---|",
    ]
    for one in found:
        table = one.agreement
        if table is not None:
            widest = table.loc[table["linear_3_sigma_m"].idxmax()]
            linear, flown, least = widest["linear_3_sigma_m"], widest["flown_3_sigma_m"], table["chance"].min()
            lines.append(
                f"| `{one.scenario.name}` | {linear:.4g} | {flown:.4g} +- {flown / np.sqrt(2 * RUNS):.2g} | {least:.2f} of "
                f"{len(table)} spacecraft |"
            )
    return "\n".join(lines)


def flights(found: Navigation) -> str:
    """What whole flights of a mission missed by and burnt, beside what covariance says."""
    plan, covariance = found.found.plan, found.covariance_N[-1]
    off, burnt = map(np.array, zip(*(flown_to_the_arrival(plan, seed) for seed in range(FLIGHTS)), strict=True))
    # Each in the unit of its own covariance, so that all are draws of one distribution.
    white = np.linalg.solve(np.linalg.cholesky(covariance), off[..., None])[..., 0].reshape(-1, 3)
    rms, expected = np.sqrt((off**2).sum(axis=2).mean()), np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean())
    return textwrap.fill(
        f"{FLIGHTS} whole flights of `{plan.scenario.name}` with two corrections, with seeds 0 to {FLIGHTS - 1}, missed their "
        f"{FLIGHTS * plan.n} points by {rms:.1f} m (root mean square; {expected:.1f} m by covariance; the chance of differing "
        f"more is {sample_chance(white, np.eye(3)):.2f} by Nagao's test of all together) and burnt {burnt.mean():.3f} m/s on "
        f"average ({found.delta_v['mean_m_s'].mean():.3f} m/s by covariance, which knows burns of no duration).",
        120,
    )


def flown_to_the_arrival(plan: Plan, seed: int) -> tuple[Array, Array]:
    """How far each spacecraft is from its visiting point at the arrival (n, 3) [m], and what it burnt (n,) [m/s]."""
    simulation = make_simulation(replace(plan, scenario=plan.scenario.model_copy(update={"seed": seed})))
    while simulation.time < plan.scenario.design.time_of_flight_s - 1e-6:
        simulation.step()
    r_N = simulation.state.r_N.copy()
    burnt = np.zeros(plan.n) if simulation.propulsion is None else simulation.propulsion.delta_v
    return r_N - plan.deployment.destination_N, burnt


def main() -> None:
    """Fly and write."""
    table, checked = missions()
    write_text(PAGE, TEXT.format(missions=table, checks=checks(checked), flights=flights(checked[0])))


if __name__ == "__main__":
    main()
