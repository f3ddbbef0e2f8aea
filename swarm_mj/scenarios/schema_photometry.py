"""How a surface reflects light: the law and its numbers, one by one or by the name of a published set."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, model_validator

from swarm_mj.scenarios.section import Section, named

LawName = Literal["lambert", "lommel_seeliger", "lunar_lambert", "akimov", "hapke"]


class Photometry(Section):
    """A reflectance law; angles of incidence and emission are those of the faces of the mesh."""

    law: LawName = Field("lambert", description="reflectance law; docs/theory/light.md")
    albedo: float = Field(
        0.2,
        gt=0,
        le=1,
        description="of all laws but hapke: I/F with the Sun and the camera in the zenith [-]; of hapke: single-scattering "
        "albedo w; default: between Bennu's 0.04 and Itokawa's 0.3, assumed",
    )
    phase_exponents: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0),
        description="b, c, d of the phase function exp(b a + c a^2 + d a^3), phase angle a in deg, of lommel_seeliger, "
        "lunar_lambert and akimov [-]; zero: none beside the law's own",
    )
    partition: tuple[float, float, float] = Field(
        (-0.019, 2.42e-4, -1.46e-6),
        description="of lunar_lambert: A, B, C of L = 1 + A a + B a^2 + C a^3 with a in deg, kept within 0 and 1 [-]; default: "
        "the Moon's, McEwen 1996, Lunar and Planetary Science Conference 27, 841",
    )
    asymmetry: float = Field(
        -0.25,
        gt=-1,
        lt=1,
        description="of hapke: g of the Henyey-Greenstein function [-]; below 0 it scatters backwards",
    )
    opposition_amplitude: float = Field(1.0, ge=0, le=10, description="of hapke: B0 of the opposition effect [-]")
    opposition_width: float = Field(0.02, gt=0, le=1, description="of hapke: h of the opposition effect [-]")
    roughness_deg: float = Field(20.0, ge=0, le=60, description="of hapke: mean slope below a face's size [deg]")
    porosity_factor: float = Field(1.0, ge=1, le=2, description="of hapke: K of Hapke 2008; 1: the classic model [-]")

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, given: Any) -> Any:
        return named(given, SETS, cls) if isinstance(given, str) else given


#: Published sets by name, each with its source.
SETS: dict[str, dict[str, Any]] = {
    # Li, A'Hearn, McFadden 2004, Icarus 172, 415: 0.55 um; geometric albedo 0.23.
    "eros": {
        "law": "hapke",
        "albedo": 0.33,
        "asymmetry": -0.25,
        "opposition_amplitude": 1.4,
        "opposition_width": 0.010,
        "roughness_deg": 28.0,
    },
    # Takir et al. 2015, Icarus 252, 393: geometric albedo 0.047 by Lommel-Seeliger, as the abstract says. The exponents are
    # those commonly quoted from it, not compared with its table; they fall by 0.04 mag/deg up to 30 deg.
    "bennu": {"law": "lommel_seeliger", "albedo": 0.047, "phase_exponents": (-4.36e-2, 2.69e-4, -9.90e-7)},
    # Kitazato et al. 2008, Icarus 194, 137, as commonly quoted, not compared with its table (roughness 26 deg, as its abstract
    # says): near infrared (1.6 um), where Itokawa is somewhat brighter than in green light.
    "itokawa": {
        "law": "hapke",
        "albedo": 0.42,
        "asymmetry": -0.35,
        "opposition_amplitude": 0.87,
        "opposition_width": 0.01,
        "roughness_deg": 26.0,
    },
    # Masoumzadeh et al. 2015, Icarus 257, 239: OSIRIS at 631.6 nm; as commonly quoted, checked by Lutetia's geometric albedo.
    "lutetia": {
        "law": "hapke",
        "albedo": 0.226,
        "asymmetry": -0.28,
        "opposition_amplitude": 1.79,
        "opposition_width": 0.041,
        "roughness_deg": 28.0,
    },
}
