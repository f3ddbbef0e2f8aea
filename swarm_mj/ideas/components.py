"""Components of CubeSats: what they weigh, take up, draw and do.

Numbers are those commonly quoted for the class that each entry names, most of them from data sheets; they were not compared
with the sheets one by one. Masses are without margin.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

Units = Literal[1, 3, 6, 12]


class Size(NamedTuple):
    """A size of the CubeSat standard (CDS, revision 14.1).

    Attributes:
        units: Nominal volumes of a litre.
        size_m: Outer size [m].
        limit_kg: Largest mass by the standard [kg].
        structure_kg: Primary structure [kg].
        aperture_m: Largest lens that its smallest face takes beside the rails [m].
        length_m: Longest optics inside, with room for the rest behind [m].
        panels: Deployed panels of three unit faces that it can carry, at most: 6U those of 120 W that Lunar IceCube carries,
            the others in proportion to their side faces.
    """

    units: int
    size_m: tuple[float, float, float]
    limit_kg: float
    structure_kg: float
    aperture_m: float
    length_m: float
    panels: int


#: Masses of structures: class of the ISISPACE CubeSat structures.
SIZES = {
    size.units: size
    for size in (
        Size(1, (0.1, 0.1, 0.1135), 2.0, 0.1, 0.09, 0.06, 2),
        Size(3, (0.1, 0.1, 0.3405), 6.0, 0.25, 0.09, 0.2, 8),
        Size(6, (0.1, 0.2263, 0.366), 12.0, 0.9, 0.09, 0.25, 14),
        Size(12, (0.2263, 0.2263, 0.366), 24.0, 1.5, 0.19, 0.25, 19),
    )
}


class Detector(NamedTuple):
    """A detector with its electronics."""

    name: str
    pixels: int  #: along a side
    pitch_m: float  #: [m]
    read_noise: float  #: electrons rms [-]
    quantum_efficiency: float  #: [-]
    mass_kg: float  #: [kg]
    volume_u: float  #: [U]
    power_w: float  #: while it takes pictures [W]
    source: str


DETECTORS = (
    Detector(
        "1k",
        1024,
        10.6e-6,
        10.0,
        0.45,
        0.10,
        0.10,
        1.5,
        "class of the IMPERX B1010 of Hera's CubeSats: 1024 px, 10.6 um",
    ),
    Detector("2k", 2048, 5.5e-6, 13.0, 0.5, 0.12, 0.10, 2.0, "class of CMOSIS CMV4000: 2048 px, 5.5 um, 13 e-"),
    Detector(
        "4k", 4096, 5.5e-6, 13.0, 0.5, 0.20, 0.15, 4.0, "class of CMOSIS CMV20000, square: 5.5 to 6.4 um, 13 e- or less"
    ),
)


class WheelSet(NamedTuple):
    """Wheels of one kind; masses and powers of one."""

    name: str
    momentum_n_m_s: float
    torque_n_m: float
    mass_kg: float
    volume_u: float
    power_w: float
    source: str


WHEELS = (
    WheelSet("RWP015", 0.015, 0.004, 0.13, 0.034, 1.0, "class of the Blue Canyon RWP015: 42 x 42 x 19 mm"),
    WheelSet("RWP050", 0.050, 0.007, 0.24, 0.09, 1.0, "class of the Blue Canyon RWP050: 58 x 58 x 25 mm"),
    WheelSet("RWP100", 0.100, 0.007, 0.33, 0.13, 1.0, "class of the Blue Canyon RWP100: 70 x 70 x 25 mm"),
    WheelSet("RWP500", 0.500, 0.025, 0.75, 0.45, 3.0, "class of the Blue Canyon RWP500: 110 x 110 x 38 mm"),
)


#: Up to this size there are miniature parts; larger spacecraft fly what has flown on them [U]. Assumed: 1U to 3U is what such
#: parts are sold for.
MINIATURE_UNITS = 3


class EarthLink(NamedTuple):
    """A deep-space transponder with an antenna; `radio` is its name in `dataflow.radios`."""

    radio: str
    mass_kg: float
    volume_u: float
    transmits_w: float  #: [W]
    listens_w: float  #: [W]
    least_units: int  #: smallest spacecraft that carries it [U]
    source: str
    most_units: int = 12  #: largest [U]


_IRIS = "class of JPL's Iris 2.1: 1.2 kg, 0.56 U, 35 W sending, 12.6 W hearing"
EARTH_LINKS = (
    EarthLink("iris_patch", 1.25, 0.6, 35.0, 12.6, 3, f"{_IRIS}; a patch"),
    EarthLink("iris_patch_array", 1.6, 0.8, 35.0, 12.6, 6, f"{_IRIS}; a face of patches"),
    EarthLink("iris_reflectarray", 2.2, 0.9, 35.0, 12.6, 6, f"{_IRIS}; MarCO's reflectarray, some 1 kg"),
    EarthLink("dish_30cm", 2.0, 1.6, 35.0, 12.6, 6, f"{_IRIS}; a deployed dish, class of KaPDA"),
    EarthLink(
        "xband_patch",
        0.30,
        0.25,
        13.0,
        1.5,
        1,
        "class of transceivers on a board, 2 W of radio frequency (ISISPACE in S band: 0.22 kg, 13 W sending, 1.2 W "
        "hearing), with a patch: no coherent ranging from Earth",
        MINIATURE_UNITS,
    ),
)


class Part(NamedTuple):
    """Anything else; masses and powers of one."""

    name: str
    mass_kg: float
    volume_u: float
    power_w: float
    source: str


#: What thrusters that burn for days need besides: jets that unload the wheels of what thrust beside the centre of mass gives
#: (1 mN by 5 mm: 0.4 N m s a day), and a drive that turns the panels to the Sun, wherever the thrust points to.
REACTION_CONTROL = Part(
    "reaction control", 0.9, 0.8, 2.0, "class of GomSpace's NanoProp 6U: butane, 0.77 kg dry, 0.9 kg full"
)
PANEL_DRIVE = Part("panel drive", 0.4, 0.2, 1.0, "assumed; M-Argo has IMT's muSADA")


class Propulsion(NamedTuple):
    """Thrusters with tank and feed."""

    name: str
    specific_impulse_s: float
    thrust_n: float
    dry_kg: float  #: without propellant and without what a tank grows by with it [kg]
    tank_share: float  #: of the propellant's mass that the tank adds [-]
    density: float  #: of the propellant [kg/U]
    most_kg: float  #: largest propellant of the class [kg]
    volume_u: float  #: without propellant [U]
    power_w: float
    source: str
    continuous: bool = (
        False  #: whether it burns for days, which panels alone can feed; else for an hour at a time at most
    )
    most_units: int = 12  #: largest spacecraft that carries it [U]

    @property
    def parts(self) -> tuple[Part, ...]:
        """What it needs besides."""
        return (REACTION_CONTROL, PANEL_DRIVE) if self.continuous else ()


PROPULSION = (
    Propulsion(
        "cold gas, isobutane",
        65.0,
        0.055,
        0.35,
        0.3,
        0.55,
        2.0,
        0.25,
        2.0,
        "class of VACCO's MEPSI system; schema_propulsion.py",
    ),
    Propulsion(
        "cold gas, R236fa",
        40.0,
        0.025,
        1.2,
        0.2,
        1.36,
        4.0,
        0.8,
        10.0,
        "class of MarCO's by VACCO: 3.5 kg with 1.9 kg of gas",
    ),
    Propulsion(
        "ADN monopropellant",
        190.0,
        0.1,
        1.25,
        0.25,
        1.24,
        0.8,
        0.75,
        10.0,
        "class of ArgoMoon's by VACCO: 1.43 kg dry, 2.07 kg full, one thruster of 100 mN and gas jets, 783 N s",
    ),
    Propulsion(
        "ASCENT monopropellant",
        220.0,
        0.4,
        3.6,
        0.25,
        1.47,
        3.0,
        1.4,
        48.0,
        "class of Lunar Flashlight's: 5.5 kg with 1.5 kg, 2.4 U, four thrusters of 100 mN, over 3,000 N s, heaters of 48 W",
    ),
    Propulsion(
        "iodine ion",
        2150.0,
        0.0011,
        1.35,
        0.1,
        4.9,
        4.0,
        1.3,
        75.0,
        "class of Busek's BIT-3: 2.9 kg with its gimbal and 1.5 kg of iodine, 1.6 U, 56 to 80 W, up to 1.2 mN",
        True,
    ),
    Propulsion(
        "ASCENT monopropellant, miniature",
        220.0,
        0.5,
        0.8,
        0.15,
        1.47,
        1.4,
        0.6,
        10.0,
        "class of MIMPS-G (Nosseir, Cervone and Pasini, Aerospace 8 (2021) 169), a design: 0.5 N, 850 to 1,350 N s from 1 U, "
        "over 3,000 from 2 U; its masses and power are assumed",
        most_units=MINIATURE_UNITS,
    ),
)


#: What every spacecraft has; small ones another attitude unit, see `bus_of`.
BUS = (
    Part("computer", 0.10, 0.10, 1.0, "class of GomSpace NanoMind A3200 on its board"),
    Part("power unit", 0.10, 0.12, 0.3, "class of GomSpace NanoPower P31u"),
    Part(
        "attitude unit",
        0.50,
        0.40,
        1.8,
        "class of the Blue Canyon XACT (0.89 to 1.23 kg, some 0.5 U) without its wheels: star tracker, gyro, electronics",
    ),
    Part(
        "crosslink radio",
        0.13,
        0.08,
        0.5,
        "class of GomSpace NanoCom AX100 (25 g) with a deployed antenna; 3 W while sending",
    ),
)
#: What small ones have in the place of the attitude unit.
MINIATURE_ATTITUDE = Part(
    "attitude unit, miniature",
    0.25,
    0.25,
    1.2,
    "class of CubeSpace's CubeADCS with its star tracker, without its wheels",
)


def bus_of(size: Size) -> tuple[Part, ...]:
    """What a spacecraft of a size has whatever it does."""
    small = size.units <= MINIATURE_UNITS
    return tuple(MINIATURE_ATTITUDE if small and part.name == "attitude unit" else part for part in BUS)


#: Power that the crosslink radio draws besides, while it sends [W].
CROSSLINK_SENDS_W = 3.0
BATTERY_WH, BATTERY = 38.5, Part("battery", 0.26, 0.19, 0.0, "class of GomSpace NanoPower BP4: four cells, 38.5 Wh")
#: A deployed panel of three unit faces: seven triple-junction cells of 30.2 cm^2 and 29.5 %, 8.5 W at 1 au.
PANEL_CELLS_M2, PANEL_EFFICIENCY = 7 * 30.18e-4, 0.295
PANEL = Part("panel", 0.20, 0.02, 0.0, "class of deployed 3U panels, hinge included")
