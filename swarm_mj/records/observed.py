"""What was observed and what was not, and why, in the numbers of a summary and in words."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.coverage import WORDS, Cause, percent_text, rounded_up_digits, shares
from swarm_mj.observation.quality import Quality
from swarm_mj.records.rounding import rounded
from swarm_mj.typing import Array

#: What would show it, by cause.
REMEDIES = {
    Cause.NO_PICTURE: "point a camera at the body (behavior, design.visiting_points)",
    Cause.OUT_OF_VIEW: "add visiting points, or widen camera.half_angle_deg",
    Cause.FACES_AWAY: "pass it on another side (design.visiting_points, mothership), or let the body turn (epoch, duration_s)",
    Cause.OBLIQUE: "add visiting points above it; observation.max_emission_deg is the limit",
    Cause.COARSE: "come nearer or see finer (design.imaging_altitude_m, camera.resolution_px); observation.max_gsd_m, "
    "max_range_m and min_pixels are the limits",
    Cause.BLURRED: "shorten camera.exposure_s; observation.max_motion_blur_px is the limit",
    Cause.HIDDEN: "add visiting points from other sides",
    Cause.DARK: "arrive when the Sun shines there (epoch), or count dark ground too (observation.light: ignored)",
    Cause.NEVER_LIT: "no path sees it: fly when the Sun shines there (epoch, duration_s), leave it out "
    "(target.region: lit), or count dark ground too (observation.light: ignored)",
    Cause.CAMERA_OFF: "let others see the same area too (designer.fold: 2)",
}
#: Of these what would help is another place to look from.
OF_THE_PATH = (Cause.OUT_OF_VIEW, Cause.FACES_AWAY, Cause.OBLIQUE, Cause.COARSE, Cause.HIDDEN)


def not_observed(area: Array, why: NDArray[np.int8], *, coming: bool = False) -> list[dict[str, Any]]:
    """Causes and their shares of the target [%], the largest first.

    Args:
        area: Of each cell [m^2], shape (n,).
        why: `Cause` of each, shape (n,).
        coming: Whether spacecraft are on their way at the epoch (`initial_states`), so that none flies to a visiting point.
    """
    remedies = REMEDIES | (dict.fromkeys(OF_THE_PATH, "another passage (initial_states) may see it") if coming else {})
    return [
        {"cause": WORDS[cause], "percent": rounded(share, 6), "remedy": remedies[cause]}
        for cause, share in shares(area, why).items()
    ]


#: What the share that a class maps does not tell.
NOT_COVERED = (
    "told by the geometry and light of the looks at the centres of faces, not by matched pictures: texture, errors of position "
    "and attitude, and what of it reaches Earth are not in it"
)


def mapped_by_class(region: TargetRegion, quality: Quality | None) -> dict[str, dict[str, float]]:
    """Share of the target that each quality class maps, by weighted area as P_TO [%], and its area [km^2], by its name."""
    return {
        name: {
            "percent": rounded(100.0 * region.weighted_area[cells].sum() / region.total_weighted_area, 6),
            "area_km2": rounded(region.area[cells].sum() / 1e6, 6),
        }
        for name, cells in (quality.mapped if quality else {}).items()
    }


def mapped_texts(summary: dict[str, Any]) -> dict[str, str]:
    """What each quality class maps, by its label in tables."""
    return {
        f"mapped, class {name}": percent_text(found["percent"]) for name, found in summary.get("classes", {}).items()
    }


def causes_text(summary: dict[str, Any]) -> str:
    """What was not observed, in one line: shares and their causes; empty where all was."""
    return ", ".join(
        f"{rounded_up_digits(part['percent'])} % {part['cause']}" for part in summary.get("not_observed", ())
    )


def observed_findings(summary: dict[str, Any]) -> list[str]:
    """One sentence for each part of the target that was not observed, and what the headline leaves out."""
    found = [
        f"{rounded_up_digits(part['percent'])} % of the target is not observed: {part['cause']}; {part['remedy']}"
        for part in summary.get("not_observed", ())
    ]
    if summary.get("target", "").startswith("lit part"):
        share = 100.0 - summary["target_percent_of_body"]
        found.append(
            f"the target is the {summary['target']}: {share:.3g} % of the body is never lit then and no part of it"
        )
    if summary.get("light") == "ignored":
        found.append(
            "light is ignored: ground that is dark or in shadow counts as observed (observation.light: sunlit asks)"
        )
    shares = ", ".join(f"{label}: {share}" for label, share in mapped_texts(summary).items())
    return found + ([f"{shares}; {NOT_COVERED}"] if shares else [])


def when_text(summary: dict[str, Any]) -> str:
    """When pictures counted, for sentences on what was observed."""
    when = "at the arrival" if summary["criterion"] == "arrival" else "in the passage"
    return when + _by_what(summary)


def criterion_text(summary: dict[str, Any]) -> str:
    """The criterion in a few words, for headings."""
    return summary["criterion"] + _by_what(summary)


def _by_what(summary: dict[str, Any]) -> str:
    """What of an observation's headline must be known: light that is ignored, area that is weighted."""
    light = ", light ignored" if summary.get("light") == "ignored" else ""
    return light + (", by weighted area" if summary.get("weighted") else "")
