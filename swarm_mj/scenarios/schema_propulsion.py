"""Cold-gas thrusters, corrections of the trajectories by them, and what a spacecraft knows of itself when it corrects.

There are none by default, for the paper's CubeSats have none. The defaults of the section are the isobutane cold-gas system
that VACCO built for MEPSI: 55 mN at 40 psia, a specific impulse of 65 s, pulses of 10 ms and so of 0.55 mN s (Osiander, Darrin
and Champion, MEMS and Microstructures in Aerospace Applications, table 11.8). Its 53 g are enough for 1 kg; here 8 kg fly, and
0.2 kg give them 16 m/s, more than the 10 m/s that the paper's swarm needs to spread from its mothership. `four_z` stands for
modules at the end of a 3U CubeSat with four nozzles about its long axis.
"""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from swarm_mj.scenarios.constants import STANDARD_GRAVITY
from swarm_mj.scenarios.section import Section


class Thrusters(Section):
    """Cold-gas thrusters with one tank; what they push with is counted inside mass_kg. See docs/theory/propulsion.md."""

    layout: Literal["six", "four_z", "sites"] = Field(
        "six",
        description="six: nozzles along +-x, +-y, +-z through the centre of mass, a force in any direction without torque; "
        "four_z: four on the -z end that push towards +z, canted outwards by 15 deg: the spacecraft turns +z along a planned "
        "burn; sites: the sites of spacecraft.mjcf whose names begin with thruster_, gas leaving along their +z",
    )
    thrust_n: float = Field(0.055, gt=0, le=1000, description="of one nozzle, the same until the tank is empty [N]")
    specific_impulse_s: float = Field(65.0, gt=0, le=10_000, description="thrust over weight flow at 9.80665 m/s^2 [s]")
    propellant_kg: float = Field(
        0.2, gt=0, description="in the tank at the start [kg]; counted inside the spacecraft's mass_kg"
    )
    min_impulse_bit_n_s: float = Field(
        0.00055,
        ge=0,
        description="impulse of a nozzle's shortest pulse [N s]; less in a control period becomes nothing or one such pulse, "
        "whichever is nearer",
    )

    @property
    def exhaust_speed(self) -> float:
        """Thrust over mass flow, g0 I_sp [m/s]."""
        return STANDARD_GRAVITY * self.specific_impulse_s


def thrusters_fit_inside(thrusters: Thrusters, hub_kg: float | None, mjcf: str | None) -> None:
    """Refuse a tank that does not fit into the hub of this mass without wheels, and nozzles that are not where the layout says.

    The hub of a file (`mjcf`) is checked when that is read, its mass is None here.
    """
    if hub_kg is not None and thrusters.propellant_kg >= hub_kg:
        raise ValueError(
            f"thrusters.propellant_kg = {thrusters.propellant_kg:g}: is counted inside mass_kg and must be below the hub's "
            f"{hub_kg:g} kg; carry less, or raise mass_kg"
        )
    if (thrusters.layout == "sites") != (mjcf is not None):
        remedy = "sites (named thruster_*)" if mjcf else "six or four_z; sites are those of a spacecraft.mjcf"
        raise ValueError(f"thrusters.layout = {thrusters.layout}: must be {remedy}")


def thrusters_can_pulse(thrusters: Thrusters, period_s: float) -> None:
    """Refuse a control period without room for the shortest pulse."""
    most = thrusters.thrust_n * period_s
    if thrusters.min_impulse_bit_n_s > most:
        raise ValueError(
            f"spacecraft.thrusters.min_impulse_bit_n_s = {thrusters.min_impulse_bit_n_s:g}: must not exceed thrust_n * "
            f"control.period_s = {most:g} N s, or no pulse ends within a control period"
        )


class Correction(Section):
    """A trajectory correction manoeuvre of every spacecraft."""

    after_release_s: float | None = Field(None, gt=0, description="time after the spacecraft's release [s]")
    before_arrival_s: float | None = Field(None, gt=0, description="time before its arrival [s]; give one of both")

    @model_validator(mode="after")
    def _one_time(self) -> Self:
        if (self.after_release_s is None) == (self.before_arrival_s is None):
            given = "none is given" if self.after_release_s is None else "both are given"
            raise ValueError(f"after_release_s, before_arrival_s: {given}; must be one of both")
        return self

    @property
    def key(self) -> str:
        """Name and value of the time, for messages."""
        if self.after_release_s is not None:
            return f"after_release_s = {self.after_release_s:g}"
        return f"before_arrival_s = {self.before_arrival_s:g}"


class Trajectory(Section):
    """What is done on the way."""

    corrections: tuple[Correction, ...] = Field(
        (),
        max_length=20,
        description="burns that bring each spacecraft back to its visiting point at its planned time, as far as it knows "
        "where it is; docs/how-to/corrections.md",
    )


def corrections_can_be_flown(trajectory: Trajectory, thrusters: Thrusters | None) -> None:
    """Refuse corrections without anything to correct with."""
    if not trajectory.corrections:
        return
    what = f"trajectory.corrections: {len(trajectory.corrections)} given"
    if thrusters is None:
        raise ValueError(f"{what}, but spacecraft.thrusters is null; give spacecraft.thrusters (its defaults: {{}})")
    if thrusters.layout == "four_z":
        raise ValueError(
            f"{what}, but spacecraft.thrusters.layout = four_z pushes only where it was turned to, and where a correction will "
            "push is not known ahead; must be six, or sites that push in every direction"
        )
