"""Write docs/results/sized.md, spacecraft from elsewhere beside what the designer makes: python -m scripts.pages.sized.

Each is described by what it had to do, as far as its sources tell, and sized as `swarm-mj ideas` sizes one.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from scripts.pages import RESULTS
from swarm_mj.ideas.components import DETECTORS, PANEL_DRIVE, SIZES
from swarm_mj.ideas.requirement import Requirement
from swarm_mj.ideas.spacecraft import Encounter, Refusal, Spacecraft, payload_for, size_spacecraft
from swarm_mj.io.atomic import write_text
from swarm_mj.observation.photometry import surface_of
from swarm_mj.scenarios.constants import AU
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema_photometry import Photometry

PAGE = RESULTS / "sized.md"
#: Its pictures and stations; all else is given here.
SCENARIO = "bennu-slow"
#: Of a white Lambert body, what is seen is so bright [-].
ALBEDO = 0.15


class Built(NamedTuple):
    """A spacecraft from elsewhere.

    Attributes:
        name: Of the mission.
        units: Its size [U].
        detector: The nearest of `components.DETECTORS`.
        asked: Values of its requirement.
        altitude_m: From where it sees what it looks at.
        speed: That it passes it with [m/s].
        sun_au: Farthest from the Sun at which it works.
        earth_au: Distance from Earth at which it sends.
        mass_kg: Launch mass.
        status: `flew`, `planned` or `study`.
        panels_w: What its panels give at 1 au; None: not in these sources.
        source: Of the numbers.
        why: What explains the difference; `{bare}` stands for the mass without margins [kg].
    """

    name: str
    units: int
    detector: str
    asked: dict[str, Any]
    altitude_m: float
    speed: float
    sun_au: float
    earth_au: float
    mass_kg: float
    status: str
    panels_w: float | None
    source: str
    why: str


BUILT = (
    Built(
        "MarCO",
        6,
        "1k",
        {
            "resolution_m": 3000,
            "delta_v_m_s": 56,
            "contact_h": 2,
            "listen_share": 0.05,
            "deliver_within_h": 0.85,  # two pictures of a megabit in contacts of 2 h a day: 8 kbit/s
            "limits": {"units": [6], "spacecraft_kg": 14, "propulsion": ["cold gas, R236fa"]},
        },
        3.5e6,
        5500.0,
        1.43,
        0.976,
        13.5,
        "flew",
        35.0,
        "NASA's press kit of InSight (13.5 kg, 35 W at Earth, 17 W at Mars, 8 kbit/s); 755 N s of its thrusters by VACCO's "
        "data sheet over 13.5 kg; contacts of 2 h a day and a receiver that is off most of the time are assumed",
        "Its UHF receiver with a deployed loop is not asked for; its panels give more than the modes of a passage need.",
    ),
    Built(
        "LICIACube",
        6,
        "2k",
        {
            "resolution_m": 1.4,
            "delta_v_m_s": 56,
            "contact_h": 4,
            "listen_share": 0.5,
            "min_snr": 5,
            "max_blur_px": 5,
            "instruments": {"mass_kg": 0.48, "volume_u": 0.6, "power_w": 3.0},
            "limits": {"units": [6], "spacecraft_kg": 14, "propulsion": ["cold gas, R236fa"]},
        },
        55_000.0,
        6150.0,
        1.05,
        0.075,
        14.0,
        "flew",
        None,
        "NASA (14 kg); scenarios/liciacube-swarm.yaml; its velocity of 56 m/s is that of MarCO's thrusters, assumed",
        "Its second camera, LUKE, is asked for as an instrument of 0.48 kg (class of the Gecko imager); its bus is made for "
        "longer missions in hard radiation.",
    ),
    Built(
        "LUMIO",
        12,
        "1k",
        {
            "resolution_m": 6000,
            "delta_v_m_s": 203,
            "contact_h": 2,
            "instruments": {
                "mass_kg": 1.3 + PANEL_DRIVE.mass_kg,
                "volume_u": 3.0,
                "power_w": 3.0 + PANEL_DRIVE.power_w,
            },
            "limits": {"units": [12], "spacecraft_kg": 24, "propulsion": ["ASCENT monopropellant"]},
        },
        6.0e7,
        100.0,
        1.0,
        0.0028,
        20.0,
        "planned",
        None,
        "eoPortal (some 20 kg); Nett, TU Delft (203 m/s; thrusters of 5.56 kg full, a second set of 0.82 kg)",
        "Its camera for flashes on the night side, some 1.3 kg and 3 U with its baffle, and the drive of its panels, that face "
        "the Sun while it watches the Moon all day, are asked for as instruments: the designer knows passages of hours alone. "
        "Thrusters of two kinds, 6.4 kg full where the designer's one kind weighs 5.5 kg, are not asked for. 28 kg are planned "
        "by now, beside which what is sized is 38 % too light.",
    ),
    Built(
        "M-Argo",
        12,
        "2k",
        {
            "resolution_m": 0.5,
            "delta_v_m_s": 3500,
            "listen_share": 0.1,
            "deliver_within_h": 200,
            "instruments": {"mass_kg": 1.0, "volume_u": 1.0, "power_w": 5.0},
            "limits": {"units": [12], "spacecraft_kg": 24, "propulsion": ["iodine ion"]},
        },
        5000.0,
        0.1,
        1.1,
        1.0,
        22.0,
        "planned",
        None,
        "ESA (12U, stays at an asteroid for six months, to 1 au from Earth; some 22 kg); 3,500 m/s assumed",
        "Infrared channels and a laser altimeter are asked for as instruments of 1 kg, which is assumed; its antenna of high "
        "gain is not: what it has to send in 200 h needs none.",
    ),
    Built(
        "3U fly-by",
        3,
        "2k",
        {
            "resolution_m": 10,
            "delta_v_m_s": 385,
            "contact_h": 1,
            "listen_share": 0.1,
            "limits": {"units": [3], "propulsion": ["ASCENT monopropellant, miniature"]},
        },
        1.0e5,
        5000.0,
        1.0,
        0.1,
        3.9,
        "study",
        None,
        "Casini et al., Aerospace 8 (2021) 9: 3.9 kg, 385 m/s; a study",
        "What the study keeps in hand was not found: the designer keeps 20 % of the mass (`margins.mass`) and 15 % for cables "
        "and brackets (`margins.integration`), which grow the propellant too; without them it is {bare} kg. The catalogue was "
        "given its miniature parts after this one had been refused.",
    ),
)


def sized(one: Built, **margins: float) -> Spacecraft | Refusal:
    """What the designer makes of what a spacecraft had to do, with other `margins` than by default."""
    margins = {"relief": 1.0, **margins}
    asked = Requirement.model_validate({"name": one.name, "scenario": SCENARIO, "margins": margins, **one.asked})
    seen = Encounter(
        area_m2=1.0,
        extent_m=100.0,
        speed=one.speed,
        altitude_m=one.altitude_m,
        sun_m=one.sun_au * AU,
        earth_m=one.earth_au * AU,
        surface=surface_of(Photometry(law="lambert", albedo=ALBEDO)),
        interval_s=10.0,
    )
    size = SIZES[one.units]
    detector = next(each for each in DETECTORS if each.name == one.detector)
    payload = payload_for(asked, seen, size, one.altitude_m, detector)
    if isinstance(payload, Refusal):
        return payload
    return size_spacecraft(asked, load_scenario(SCENARIO), seen, size, payload)


def _row(one: Built) -> str:
    found, panels = sized(one), "-" if one.panels_w is None else f"{one.panels_w:g}"
    asked = f"{one.asked['delta_v_m_s']:g} m/s, {one.sun_au:g} au from the Sun, {one.earth_au:g} au from Earth"
    told = f"| {one.name}, {one.units}U, {one.status} | {asked} | {one.mass_kg:g} | "
    if isinstance(found, Refusal):
        return f"{told}refused | - | - | - | {panels} | - |"
    bare = sized(one, mass=0.0)
    kept = "- | -" if isinstance(bare, Refusal) else f"{bare.mass_kg:.1f} | {_off(bare, one):+.0f} %"
    given = found.available_w * one.sun_au**2
    return f"{told}{found.mass_kg:.1f} | {_off(found, one):+.0f} % | {kept} | {panels} | {given:.0f} |"


def _off(found: Spacecraft, one: Built) -> float:
    """Difference of the masses [%]."""
    return 100.0 * (found.mass_kg / one.mass_kg - 1.0)


def _within(**margins: float) -> str:
    """Those whose mass is met within 15 %."""
    near = [
        one.name
        for one in BUILT
        if isinstance(found := sized(one, **margins), Spacecraft) and abs(_off(found, one)) <= 15.0
    ]
    return f"{', '.join(near) or 'none'}, of {len(BUILT)}"


def _asked(one: Built) -> str:
    """What it had to do, key by key."""
    flat = {
        f"{key}.{inner}" if inner else key: each
        for key, value in one.asked.items()
        for inner, each in (value.items() if isinstance(value, dict) else [("", value)])
    }
    told = [f"`{key}` {_shown(value)}" for key, value in flat.items()]
    told += [f"a detector of the class {one.detector}", f"from {one.altitude_m / 1e3:,g} km at {one.speed:,g} m/s"]
    return ", ".join(told) + f", albedo {ALBEDO:g}"


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_shown, value))
    return value if isinstance(value, str) else f"{value:g}"


def _chosen(found: Spacecraft) -> str:
    by = "" if found.propulsion is None else f", {found.propulsion.name}"
    return f"{found.wheels.name}, {found.link.radio}{by}"


def main() -> None:
    """Write the page."""
    lines = [
        "# Sized, and what flew or is planned",
        "",
        "What the spacecraft designer makes of what other spacecraft had to do, by `python -m scripts.pages.sized`: their",
        "size, thrusters, instruments, pixel, distances and contacts, as far as their sources tell; where they do not, what is",
        "asked for is assumed. All of it stands below; the rest is by default, margins included but for that of slants",
        "(`margins.relief` is 1: pixels are those of a passage straight above). It looks for the lightest that does it.",
        "",
        f"Within 15 % of the mass, with the 20 % that a design keeps in hand (`margins.mass`): {_within()}.",
        f"What flew has used up what it had in hand; without it: {_within(mass=0.0)}. **The masses of 6U and 12U",
        "come out too small by about that margin**: what is built carries what no key asks for, as named below. Two of the",
        "five flew, two are planned, and one is a study. Of power one number was found, MarCO's.",
        "",
        "They are no independent check of the catalogue. Its cold-gas thrusters, its reflectarray and its transponder are of",
        "the classes of MarCO's. After a first comparison, in which all came out lighter still, it was given the share for",
        "cables, brackets and shielding, a heavier attitude unit, other thrusters by the numbers of ArgoMoon's, Lunar",
        "Flashlight's and of the BIT-3, for thrusters that burn for days the gas jets and the panel drive that M-Argo has,",
        "and for up to 3U an attitude unit, a transceiver and thrusters that are smaller. Each may take one kind of thrusters",
        "alone, that of `limits.propulsion`.",
        "",
        "| spacecraft | had to do | built, planned [kg] | sized [kg] | difference | nothing in hand [kg] | difference "
        "| panels at 1 au [W] | sized panels [W] |",
        "|---|---|---|---|---|---|---|---|---|",
        *map(_row, BUILT),
        "",
    ]
    for one in BUILT:
        found = sized(one)
        words = f" Refused: {found.words}." if isinstance(found, Refusal) else ""
        chosen = "" if isinstance(found, Refusal) else f" It took {_chosen(found)}."
        bare = sized(one, mass=0.0, integration=0.0)
        why = one.why.format(bare="-" if isinstance(bare, Refusal) else f"{bare.mass_kg:.1f}")
        lines += [f"**{one.name}.** {why}{words}{chosen} Source: {one.source}. Asked: {_asked(one)}.", ""]
    write_text(PAGE, "\n".join(lines))


if __name__ == "__main__":
    main()
