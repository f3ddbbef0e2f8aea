"""Which spacecraft a scenario flies: the packaged CubeSat with the scenario's numbers, or one from an MJCF file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from swarm_mj.errors import ScenarioError
from swarm_mj.io.resources import asset_path
from swarm_mj.scenarios.schema import Scenario, Spacecraft, Wheel
from swarm_mj.spacecraft.elastic import lost_to_the_step
from swarm_mj.spacecraft.own_spacecraft import OwnSpacecraft, read_spacecraft, small_motions
from swarm_mj.spacecraft.properties import RPM, WHEEL_AXES, SpacecraftProperties
from swarm_mj.spacecraft.template import TEMPLATE, is_shipped

#: Relative difference between a scenario's number and the file's that is put down to its digits.
AGREES = 1e-3
#: Share of an amplitude that the integration may take away in a flight without a word.
WORTH_A_NOTE = 0.01


def properties_from(scenario: Scenario) -> SpacecraftProperties:
    """Mass properties and wheel limits by the scenario's numbers, which are those of the packaged CubeSat."""
    spacecraft, wheel = scenario.spacecraft, scenario.spacecraft.wheel
    return SpacecraftProperties(
        mass=spacecraft.mass_kg,
        size=spacecraft.size_m,
        wheel_mass=wheel.mass_kg,
        wheel_spin_inertia=wheel.spin_inertia_kg_m2,
        wheel_transverse_inertia=wheel.transverse_inertia_kg_m2,
        max_wheel_torque=wheel.max_torque_n_m,
        max_wheel_speed=wheel.max_speed_rpm * RPM,
        wheel_layout=spacecraft.wheel_layout,
        thrusters=spacecraft.thrusters,
    )


def own_spacecraft_from(scenario: Scenario) -> OwnSpacecraft | None:
    """The spacecraft of a file: of `spacecraft.mjcf`, or of the packaged one where that was changed; None: as packaged.

    Raises:
        ScenarioError: The file holds no spacecraft that can be flown, or the scenario asks for another one or another stepper.
    """
    planned, mjcf = properties_from(scenario), scenario.spacecraft.mjcf
    if mjcf is None and is_shipped():
        return None
    path = Path(mjcf or str(asset_path(TEMPLATE)))
    own = read_spacecraft(path, planned)
    if scenario.physics.stepper == "kernel":
        raise ScenarioError(
            f"physics.stepper = kernel: flies the CubeSat as it was shipped, not {path}; use physics.stepper: mujoco"
        )
    if wrong := list(_contradictions(scenario.spacecraft, own)):
        raise ScenarioError(
            f"{'; '.join(wrong)}: a spacecraft from a file has the file's masses and wheels. Leave the key out, or change "
            "the file"
        )
    return own


def notes_on(scenario: Scenario, own: OwnSpacecraft) -> list[str]:
    """What a reader of a flight should know of the spacecraft's file, one sentence each."""
    return [*own.remarks, *unused_keys(scenario, own), *_step_notes(scenario, own)]


def _step_notes(scenario: Scenario, own: OwnSpacecraft) -> Iterator[str]:
    """Motions that the integration damps more than their own dampers do."""
    step, duration = scenario.physics.timestep_s, scenario.duration_s
    for mode in small_motions(own):
        lost, kept = lost_to_the_step(mode, step, duration), np.exp(mode.eigenvalue.real * duration)
        if abs(lost) > WORTH_A_NOTE and kept > WORTH_A_NOTE:
            yield (
                f"joint {mode.joint} swings with {mode.frequency_hz:.3g} Hz; steps of physics.timestep_s = {step:g} s take "
                f"{100 * lost:.2g} % of its amplitude away during the flight: shorter steps take less"
            )


def unused_keys(scenario: Scenario, own: OwnSpacecraft) -> list[str]:
    """Keys that the scenario gives and the file's spacecraft does not follow, with both values, one sentence each."""
    found = []
    for key, section, field, value in _compared(scenario.spacecraft, own):
        given = getattr(section, field)
        if field in section.model_fields_set and not _agrees(given, value):
            found.append(f"{key} = {given:g} is not used: it is {value:.6g} in {own.path.name}")
    return found


def _compared(spacecraft: Spacecraft, own: OwnSpacecraft) -> Iterator[tuple[str, Spacecraft | Wheel, str, float]]:
    """Key, section, field, and what the file says, of every number that both could say."""
    wheel, properties = spacecraft.wheel, own.properties
    yield "spacecraft.mass_kg", spacecraft, "mass_kg", properties.mass
    yield "spacecraft.wheel.mass_kg", wheel, "mass_kg", properties.wheel_mass
    yield "spacecraft.wheel.spin_inertia_kg_m2", wheel, "spin_inertia_kg_m2", properties.wheel_spin_inertia
    yield "spacecraft.wheel.max_torque_n_m", wheel, "max_torque_n_m", properties.max_wheel_torque


def _contradictions(spacecraft: Spacecraft, own: OwnSpacecraft) -> Iterator[str]:
    """What the scenario says otherwise than the file, and otherwise than by default.

    Values are compared with the defaults, not keys that were given: a scenario that a run wrote gives all of them.
    """
    for key, section, field, value in _compared(spacecraft, own):
        given = getattr(section, field)
        if given != type(section).model_fields[field].default and not _agrees(given, value):
            yield f"{key} = {given:g} in the scenario, {value:.6g} in {own.path}"
    layout, axes = spacecraft.wheel_layout, own.properties.wheel_axes_B
    if layout != "orthogonal":
        wanted = WHEEL_AXES[layout]
        if wanted.shape != axes.shape or not np.allclose(wanted, axes, atol=AGREES):
            yield f"spacecraft.wheel_layout = {layout} in the scenario, the axes {np.round(axes, 3).tolist()} in {own.path}"


def _agrees(given: float, value: float) -> bool:
    return abs(given - value) <= AGREES * abs(value)
