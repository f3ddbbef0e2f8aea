"""Gravity fields of the body, interchangeable through the one-method protocol `Gravity`."""

from swarm_mj.smallbody.gravity.base import Gravity
from swarm_mj.smallbody.gravity.point_mass import PointMass
from swarm_mj.smallbody.gravity.polyhedron import Polyhedron
from swarm_mj.smallbody.gravity.spherical_harmonics import SphericalHarmonics, fit_harmonics

__all__ = ["Gravity", "PointMass", "Polyhedron", "SphericalHarmonics", "fit_harmonics"]
