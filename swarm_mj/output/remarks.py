"""What a reader should know before believing a run's numbers."""

from __future__ import annotations

from typing import Any

#: Pointing errors above this at the end or before a switch are worth a remark [deg].
SETTLED_DEG = 0.1


def remarks(summary: dict[str, Any]) -> list[str]:
    """Remarks on pointing that had not settled and wheels at their limits, one sentence each."""
    found = []
    for when, key in (
        ("at the end", "pointing_error_deg_final"),
        ("before a switch", "pointing_error_deg_before_switch"),
    ):
        late = {name: error for name, error in summary[key].items() if error > SETTLED_DEG}
        if late:
            worst = max(late.values())
            found.append(f"pointing had not settled {when}: {', '.join(late)}, up to {worst:.3g} deg")
    cut = {name: seconds for name, seconds in summary["wheel_saturation_s"].items() if seconds > 0}
    if cut:
        found.append(
            f"wheel limits cut the controller's torque: {', '.join(f'{n} for {s:g} s' for n, s in cut.items())}"
        )
    return found


def near_collision_remarks(summary: dict[str, Any]) -> list[str]:
    """One sentence for each pair that came too close."""
    return [
        f"near-collision of {near['spacecraft'][0]} and {near['spacecraft'][1]}, {near['distance_m']:.1f} m at "
        f"t = {near['time_s']:.0f} s"
        for near in summary["near_collisions"]
    ]
