r"""Flyby altitude and camera half-angle from a required ground resolution.

AAS 19-144 asks for a ground resolution D of 10 cm and takes the altitude (14 km) and the half cone angle (21.5 deg)
'using coverage relations for an optical instrument', citing Wertz, *Mission Geometry* (its reference 13), without
writing them. Written out, with every assumption named:

**Altitude.** An ideal lens of aperture a resolves two points separated by the Rayleigh angle 1.22 lambda / a. Seen from
straight above at altitude h they are D apart when

    h = D a / (1.22 lambda).

Green light (550 nm) and an aperture of 94 mm, about the largest that fits a 3U CubeSat's 0.1 m face, give
h = 14.01 km for D = 0.1 m. The paper states neither; 14 km exactly would be 93.94 mm. Diffraction alone is meant: to
*sample* 10 cm over the whole field of view a picture would need 2 h tan(21.5 deg) / D = 110,000 pixels across.

**Half-angle.** A camera at altitude h over a sphere of radius R sees the ground point at the body-centred angle beta
from its nadir at the nadir angle eta. In the triangle camera, centre, point, with sin rho = R / (R + h) (rho is the
angle to the horizon),

    tan eta = sin rho sin beta / (1 - sin rho cos beta).

The camera sees the whole region from above its middle if its half-angle is eta for the region's half-angle,
beta = 20 deg. What comes out depends on the sphere that stands for Eros at h = 14 km:

    R                                          eta(20 deg)
    5.84 km, Eros at 0 N, 90 E                  7.9 deg
    8.42 km, sphere of equal volume            11.2 deg
    17.2 km, half of Eros's 34.4 km length     21.4 deg   <- default
    17.33 km                                   21.5 deg
    17.7 km, farthest vertex from the centre   21.9 deg

So the paper's 21.5 deg follows within 0.15 deg from a sphere about the whole body; it is not derivable from the ground
under the camera, where 8 deg would do. Another reading, the horizon's own angle rho of the sphere of equal volume, gives
22.1 deg. The paper does not tell which was meant, and this module does not claim to know.

A scenario that states `camera.ground_resolution_m` gets from here what it leaves open, see `with_ground_resolution`.
"""

from math import asin, atan2, cos, degrees, isfinite, radians, sin

from swarm_mj.errors import MissionError, ScenarioError, at_most
from swarm_mj.io.values import shown
from swarm_mj.scenarios.constants import CUBESAT_APERTURE_M, GREEN_LIGHT_M, LONGEST_EXTENT_M
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_body import Body

#: First zero of the Airy pattern over pi: Rayleigh's criterion for a circular aperture.
RAYLEIGH = 1.22
#: Largest relative excess of an altitude over the highest one that is rounding, as of a number in a file.
ROUNDING = 1e-9


def diffraction_altitude(
    ground_resolution_m: float, *, aperture_m: float = CUBESAT_APERTURE_M, wavelength_m: float = GREEN_LIGHT_M
) -> float:
    """Altitude [m] at which an ideal lens just resolves `ground_resolution_m` straight below.

    Raises:
        MissionError: A value is not positive.
    """
    _check_positive(ground_resolution_m=ground_resolution_m, aperture_m=aperture_m, wavelength_m=wavelength_m)
    return ground_resolution_m * aperture_m / (RAYLEIGH * wavelength_m)


def horizon_angle_deg(*, altitude_m: float, body_radius_m: float) -> float:
    """Angle [deg] between nadir and horizon of a sphere, rho.

    Raises:
        MissionError: A value is not positive.
    """
    _check_positive(altitude_m=altitude_m, body_radius_m=body_radius_m)
    return degrees(asin(body_radius_m / (body_radius_m + altitude_m)))


def nadir_angle_deg(central_angle_deg: float, *, altitude_m: float, body_radius_m: float) -> float:
    """Angle [deg] at the camera between nadir and a ground point of a sphere, eta.

    Args:
        central_angle_deg: Angle at the sphere's centre between the camera and the point [deg].
        altitude_m: Altitude of the camera [m].
        body_radius_m: Radius of the sphere [m].

    Raises:
        MissionError: A value is not positive, or the point lies beyond the horizon.
    """
    horizon = horizon_angle_deg(altitude_m=altitude_m, body_radius_m=body_radius_m)
    _check_positive(central_angle_deg=central_angle_deg)
    if central_angle_deg > 90.0 - horizon:
        raise MissionError(
            f"a region of half-angle {central_angle_deg} deg reaches beyond the horizon, which lies {90 - horizon:.2f} "
            f"deg from nadir at {altitude_m:.0f} m over a sphere of {body_radius_m:.0f} m: fly higher or shrink it"
        )
    ratio, angle = sin(radians(horizon)), radians(central_angle_deg)
    return degrees(atan2(ratio * sin(angle), 1.0 - ratio * cos(angle)))


def with_ground_resolution(scenario: Scenario) -> Scenario:
    """The scenario with altitude and half-angle that follow from `camera.ground_resolution_m`, where it gives none itself.

    An altitude of its own is kept if the lens resolves the ground from there; a half-angle of its own is kept in any case,
    since several spacecraft may share a target. Without a ground resolution nothing changes.

    Raises:
        ScenarioError: The lens does not resolve the ground from the scenario's altitude, or no half-angle follows.
    """
    camera, design = scenario.camera, scenario.design
    resolution = camera.ground_resolution_m
    if resolution is None:
        return scenario
    highest = diffraction_altitude(resolution, aperture_m=camera.aperture_m, wavelength_m=camera.wavelength_m)
    altitude = design.imaging_altitude_m if "imaging_altitude_m" in design.model_fields_set else highest
    if altitude > highest * (1.0 + ROUNDING):
        raise ScenarioError(
            f"design.imaging_altitude_m = {altitude:g}: must be at most {at_most(highest, 6)}, from where a lens of "
            f"camera.aperture_m = {camera.aperture_m:g} resolves camera.ground_resolution_m = {resolution:g} at "
            f"camera.wavelength_m = {camera.wavelength_m:g}; leave it out to get that, or change one of these"
        )
    half_angle = (
        camera.half_angle_deg if "half_angle_deg" in camera.model_fields_set else _half_angle(scenario, altitude)
    )
    return scenario.model_copy(
        update={
            "design": design.model_copy(update={"imaging_altitude_m": altitude}),
            "camera": camera.model_copy(update={"half_angle_deg": half_angle}),
        }
    )


def _half_angle(scenario: Scenario, altitude_m: float) -> float:
    """Half-angle [deg] of a camera that sees the scenario's target region from this altitude [m]."""
    if scenario.target.region != "pyramid":
        raise ScenarioError(
            f"camera.half_angle_deg: missing; with camera.ground_resolution_m it follows for target.region = pyramid, not for "
            f"{scenario.target.region}: give it"
        )
    radius = _half_length(scenario.body)
    try:
        return nadir_angle_deg(scenario.target.half_angle_deg, altitude_m=altitude_m, body_radius_m=radius)
    except MissionError as error:
        raise ScenarioError(
            f"camera.half_angle_deg: missing, and does not follow from camera.ground_resolution_m: {error}; or give it"
        ) from None


def _half_length(body: Body) -> float:
    """Half of the body's longest extent [m], the radius of a sphere about all of it."""
    if body.semi_axes_m is not None:
        return max(body.semi_axes_m)
    if body.shape not in LONGEST_EXTENT_M:
        raise ScenarioError(
            "camera.half_angle_deg: missing; with camera.ground_resolution_m it follows for bodies whose longest extent is "
            f"known, body.shape = {', '.join(LONGEST_EXTENT_M)} or ellipsoid, and not for {shown(body.shape)}: give it"
        )
    return 0.5 * LONGEST_EXTENT_M[body.shape]


def _check_positive(**values: float) -> None:
    for name, value in values.items():
        if not (isfinite(value) and value > 0.0):
            raise MissionError(f"{name} is {value}: it must be a positive number")
