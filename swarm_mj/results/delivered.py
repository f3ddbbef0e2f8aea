"""What reached Earth, in the numbers of summary.json and in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.flight.deliver import MOST_SPACECRAFT, PROOF_S
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.links import Obstacle
from swarm_mj.results.remedies import remedy
from swarm_mj.typing import Array


def delivered_summary(plan: Plan, delivery: Delivery | None) -> dict[str, Any]:
    """The keys of summary.json about the way to Earth; empty where it was not computed."""
    if delivery is None:
        return {}
    names, link = plan.names, plan.scenario.link
    percent = 100.0 / plan.region.total_area
    return {
        "delivered_percent": _rounded(percent * delivery.delivered_area, 6),
        "delivered_percent_bound": _known(percent * float(delivery.best_bound_area), 6),
        "seen_bits": delivery.seen_bit,
        "delivered_bits": delivery.delivered_bit,
        "aboard_bits": int(delivery.aboard_bit[-1].sum()),
        "lost_bits": int(delivery.lost_bit[-1].sum()),
        "time_to_full_map_s": _known(delivery.full_s, 3),
        "time_to_full_map_s_bound": _known(float(delivery.best_full_s), 3) if delivery.complete else None,
        "delivery_window_s": [_rounded(delivery.edges_s[0], 3), _rounded(delivery.edges_s[-1], 3)],
        "link_time_s": {n: _rounded(s, 3) for n, s in zip(names, link_time_s(delivery), strict=True)},
        "lost_after_s": {names[j]: _rounded(t, 3) for j, t in _lost_after(plan, delivery)},
        "relays_after": [names[j] for j in delivery.relay],
        "elected_by": plan.scenario.data.election,
        "elections": [
            {"time_s": _rounded(time_s, 3), "relays": [names[j] for j in np.flatnonzero(who)]}
            for time_s, who in zip(delivery.election_s, delivery.elected, strict=True)
        ],
        "radios": {
            "crosslink": link.crosslink.radio,
            "antenna": link.crosslink.antenna,
            "earth": link.earth.radio,
            "network": "own stations" if link.ground.stations else link.ground.network,
        },
        "not_delivered": [
            {
                "reason": part.reason,
                "percent": _rounded(percent * part.area, 6),
                "spacecraft": [names[j] for j in part.holders],
                "remedy": remedy(plan, delivery, part),
            }
            for part in delivery.undelivered()
        ],
    }


def link_time_s(delivery: Delivery) -> Array:
    """How long each spacecraft could send to Earth, or to one that could at the time, shape (n,) [s]."""
    speaks = delivery.earth_contact_bit > 0
    reaches = speaks | ((delivery.contact_bit > 0) & speaks[:, None, :]).any(axis=2)
    return np.asarray(np.diff(delivery.edges_s) @ reaches)


def _lost_after(plan: Plan, delivery: Delivery) -> Iterator[tuple[int, float]]:
    """Who hits the body after the flight, and the start of the slot from which it is lost [s]."""
    after = delivery.edges_s[:-1] >= plan.scenario.duration_s
    for j in range(delivery.n):
        lost = delivery.why_earth[:, j] == Obstacle.LOST
        if lost[-1] and (k := int(np.argmax(lost))) and after[k]:
            yield j, float(delivery.edges_s[k])


def undelivered_findings(summary: dict[str, Any]) -> list[str]:
    """One sentence for each part of the map that was seen and does not arrive."""
    lost = [
        f"{part['percent']:.2f} % of the target is seen and not delivered ({_listed(part['spacecraft'])}): "
        f"{part['reason']}; {part['remedy']}"
        for part in summary.get("not_delivered", ())
    ]
    return _unknown_findings(summary) + _fallen_findings(summary.get("lost_after_s", {})) + lost


def _unknown_findings(summary: dict[str, Any]) -> list[str]:
    """What of the way to Earth was not computed."""
    if summary.get("delivered_percent") is None:
        n = summary["spacecraft"]
        many = f"the way to Earth is not computed for {n} spacecraft, at most for {MOST_SPACECRAFT}"
        return [many] if n > MOST_SPACECRAFT else []
    late = f"the best schedule of transfers is not proven: that takes more than {PROOF_S:g} s"
    return [late] if summary.get("delivered_percent_bound") is None else []


def _fallen_findings(fallen: dict[str, float]) -> list[str]:
    if not fallen:
        return []
    hit, first = "hits" if len(fallen) == 1 else "hit", min(fallen.values())
    return [f"{_listed(list(fallen))} {hit} the body after the flight, from t = {first:.0f} s on, with what is aboard"]


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:10]) + (f" and {len(names) - 10} more" if len(names) > 10 else "")


def _known(value: float, digits: int) -> float | None:
    return None if np.isnan(value) else _rounded(value, digits)


def _rounded(value: float, digits: int) -> float:
    return round(float(value), digits)
