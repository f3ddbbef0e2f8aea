"""Colours of the drawing, those of Okabe and Ito (2008), which hold for any common colour blindness, on black."""

from __future__ import annotations

from swarm_mj.mission.behaviors import TargetKind

Rgb = tuple[int, int, int]

#: Bare ground, target cells that were observed, borders of target faces that were not.
GROUND: Rgb = (158, 146, 132)
SEEN: Rgb = (86, 180, 233)
SEEN_BORDER: Rgb = (0, 114, 178)
UNSEEN_BORDER: Rgb = (230, 159, 0)

TEXT: Rgb = (240, 240, 240)
FAINT: Rgb = (150, 150, 150)
TRAIL: Rgb = (190, 190, 190)

#: What navigation by pictures believes.
BELIEVED: Rgb = (240, 228, 66)

#: Data under way: packets and what is said of them, and the lines that they move along.
PACKET: Rgb = (255, 176, 222)
PACKET_LINE: Rgb = (204, 121, 167)

#: What a spacecraft's +z tracks: the colour of its line of sight and of its name.
MODES: dict[TargetKind, Rgb] = {
    TargetKind.ASTEROID: (255, 121, 51),  # vermillion, lighter so that it reads on black
    TargetKind.SURFACE: (255, 121, 51),
    TargetKind.SPACECRAFT: (0, 190, 140),
    TargetKind.EARTH: (240, 228, 66),
    TargetKind.DIRECTION: (170, 170, 170),
}


def rgba(colour: Rgb, alpha: float = 1.0) -> tuple[float, float, float, float]:
    """A colour as MuJoCo takes it."""
    return colour[0] / 255.0, colour[1] / 255.0, colour[2] / 255.0, alpha
