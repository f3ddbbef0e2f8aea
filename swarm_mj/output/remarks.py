"""What a reader should know before believing a run's numbers."""

from __future__ import annotations

from typing import Any

#: Pointing errors above this at the end or before a switch are worth a remark [deg].
SETTLED_DEG = 0.1
#: Events that are listed one by one.
MOST_EVENTS = 30


def remarks(summary: dict[str, Any]) -> list[str]:
    """Remarks on what went wrong, pointing that had not settled and wheels at their limits, one sentence each."""
    found = []
    for when, key in (
        ("at the end", "pointing_error_deg_final"),
        ("before a switch", "pointing_error_deg_before_switch"),
    ):
        late = {
            n: error for n, error in summary[key].items() if error > SETTLED_DEG and n not in summary.get("lost", ())
        }
        if late:
            worst = max(late.values())
            found.append(f"pointing had not settled {when}: {', '.join(late)}, up to {worst:.3g} deg")
    cut = {name: seconds for name, seconds in summary["wheel_saturation_s"].items() if seconds > 0}
    if cut:
        found.append(
            f"wheel limits cut the controller's torque: {', '.join(f'{n} for {s:g} s' for n, s in cut.items())}"
        )
    return [*event_remarks(summary), *found]


def event_remarks(summary: dict[str, Any]) -> list[str]:
    """One sentence for each fault and what followed from it, the first `MOST_EVENTS`."""
    events = summary.get("events", ())
    found = [
        f"t = {event['time_s']:g} s, {event['spacecraft']}: {event['kind'].replace('_', ' ')}"
        + (f" ({event['detail']})" if event["detail"] else "")
        for event in events[:MOST_EVENTS]
    ]
    return found + (
        [f"and {len(events) - len(found)} more events, see summary.json"] if len(events) > len(found) else []
    )


def near_collision_remarks(summary: dict[str, Any]) -> list[str]:
    """One sentence for each pair that came too close."""
    return [
        f"near-collision of {near['spacecraft'][0]} and {near['spacecraft'][1]}, {near['distance_m']:.1f} m at "
        f"t = {near['time_s']:.0f} s"
        for near in summary["near_collisions"]
    ]
