"""Hold formulas of optical navigation against GIANT 2.0, and write docs/results/giant.md.

Run: python -m scripts.pages.giant --giant DIR, where DIR is a clone of github.com/nasa/giant with its extensions built in place
(python setup.py build_ext --inplace), and its dependencies are installed. It is not among ours, and nothing of it is here.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np

from scripts.pages import RESULTS
from swarm_mj.io.atomic import write_text
from swarm_mj.navigation.limb import horizon_position
from swarm_mj.observation.camera import look_at
from swarm_mj.observation.lens import Distortion, Lens
from swarm_mj.observation.photometry import radiance_factor, surface_of
from swarm_mj.scenarios.schema_photometry import Photometry
from swarm_mj.typing import Array

PAGE = RESULTS / "giant.md"
#: An ellipsoid [m], the distance of the camera from it [m], focal length and error of points of the limb [px].
AXES, DISTANCE, FOCAL_PX, EDGE_PX = np.array([1000.0, 800.0, 500.0]), 7000.0, 3000.0, 0.1
#: Points of a lit limb, over which angle [deg], and limbs that are measured.
POINTS, ARC_DEG, LIMBS = 80, 160.0, 300
DISTORTION = Distortion(k1=-0.21, k2=0.08, p1=1e-3, p2=-7e-4, k3=0.02)

TEXT = """# GIANT beside ours

Written by `python -m scripts.pages.giant --giant DIR` with GIANT {version} (github.com/nasa/giant), NASA's program for optical
navigation, as an independent reference of formulas.

| what | of | largest difference |
|---|---|---|
| Brown's distortion, `BrownModel` | 200 points within 29 deg | {brown:.1g} px |
| Lambert, `LambertianIllumination` | 500 directions | {lambert:.1g} of the value |
| Lommel-Seeliger, `LommelSeeligerIllumination` | 500 directions | {lommel_seeliger:.1g}, but for a factor of 2 |
| lunar-Lambert, `McEwenIllumination` | 500 directions | {lunar_lambert:.1g} of the value |

GIANT leaves out the 2 of Lommel and Seeliger's law, which scales a picture and moves nothing in it. Its weight of the
lunar-Lambert law is exp(-phase / 60 deg), with which ours was compared; the default here is McEwen's polynomial.

**Horizon of an ellipsoid** (`EllipseMatching`, Christian and Robinson): {limbs} limbs of 160 deg and 80 points with an error of
0.1 px, of an ellipsoid of 1,000, 800 and 500 m from 7 km, 3,000 px of focal length.

| | across [m rms] | along the line of sight [m rms] | errors over the covariance, chi-square a component |
|---|---|---|---|
| GIANT | {their_across:.4f} | {their_along:.3f} | {their_chi:.2f} |
| ours | {our_across:.4f} | {our_along:.3f} | {our_chi:.2f} |

Ours weights each line of sight by what it says of the position, GIANT takes all alike: the two positions differ by
{apart:.2f} of one sigma of ours (rms a component). Ours takes the error that is given. GIANT's covariance is of the scatter in
x and in y between each point and the nearest one of the limb: an error across the limb is shared between the two, so that each
has about half of its square, and the covariance is about half of what errors come to.

Not compared: GIANT's extraction of limbs from pictures. In this version its limb scanner ends in an error of shapes, and its
edge detector found no limbs of our pictures of spheres, with the defaults of both.
"""


def giant_of(folder: Path) -> types.SimpleNamespace:
    """What is compared of GIANT."""
    sys.path.append(str(folder))
    # Its matching of features asks for a package of learned matchers, which is used for none of this.
    stub = types.ModuleType("giant.image_processing.feature_matchers")
    stub.__path__ = []

    def anything(name: str) -> type:
        if name.startswith("__"):
            raise AttributeError(name)
        return type(name, (), {})

    stub.__getattr__ = anything  # type: ignore[method-assign]
    sys.modules[stub.__name__] = stub
    names = {
        "camera_models": ("BrownModel", "PinholeModel"),
        "camera": ("Camera",),
        "image": ("OpNavImage",),
        "ray_tracer.scene": ("Scene", "SceneObject"),
        "ray_tracer.shapes": ("Ellipsoid", "Point"),
        "ray_tracer.illumination": (
            "ILLUM_DTYPE",
            "LambertianIllumination",
            "LommelSeeligerIllumination",
            "McEwenIllumination",
        ),
        "relative_opnav.estimators.ellipse_matching": (
            "EllipseMatching",
            "EllipseMatchingOptions",
            "LimbExtractionMethods",
        ),
    }
    found: dict[str, Any] = {}
    for module, wanted in names.items():
        loaded = importlib.import_module(f"giant.{module}")
        found |= {name: getattr(loaded, name) for name in wanted}
    return types.SimpleNamespace(**found)


def brown(giant: Any, rng: np.random.Generator) -> float:
    """Largest difference of distorted points [px]; GIANT counts from the middle of the first pixel."""
    ours = Lens(1024, 768, 900.0, DISTORTION, 512.0, 384.0)
    theirs = giant.BrownModel(kx=900.0, ky=900.0, px=511.5, py=383.5, n_rows=768, n_cols=1024, **DISTORTION._asdict())
    points = np.column_stack((rng.uniform(-0.5, 0.5, 200), rng.uniform(-0.4, 0.4, 200), np.ones(200)))
    return float(np.abs(ours.to_pixels(points) - 0.5 - theirs.project_onto_image(points.T).T).max())


def laws(giant: Any, rng: np.random.Generator) -> dict[str, float]:
    """Largest difference of each reflectance law, over its value."""
    normal = _unit(rng.normal(size=(500, 3)))
    sun, camera = (_unit(normal + 0.9 * _unit(rng.normal(size=(500, 3)))) for _ in range(2))
    asked = np.zeros(500, dtype=giant.ILLUM_DTYPE)
    for key, values in {
        "normal": normal,
        "incidence": -sun,
        "exidence": camera,
        "albedo": 0.3,
        "visible": True,
    }.items():
        asked[key] = values
    angles = np.column_stack([(a * b).sum(1) for a, b in ((normal, sun), (normal, camera), (sun, camera))])
    found = {}
    for name, law in {
        "lambert": giant.LambertianIllumination(),
        "lommel_seeliger": giant.LommelSeeligerIllumination(),
        "lunar_lambert": giant.McEwenIllumination(),
    }.items():
        times = 2.0 if name == "lommel_seeliger" else 1.0
        ours = np.array([_factor(name, *row) for row in angles])
        found[name] = float(np.abs(ours / (times * law(asked)) - 1.0).max())
    return found


def _factor(law: str, mu0: float, mu: float, cos_phase: float) -> float:
    phase = float(np.degrees(np.arccos(cos_phase)))
    weight = {"partition": ((np.exp(-phase / 60.0) - 1.0) / phase, 0.0, 0.0)} if law == "lunar_lambert" else {}
    surface = surface_of(Photometry.model_validate({"law": law, "albedo": 0.3, **weight}))
    return radiance_factor(surface, mu0, mu, cos_phase)


def horizons(giant: Any, rng: np.random.Generator) -> dict[str, float]:
    """Errors of positions by noisy limbs, by both, and how far apart they are."""
    model = giant.PinholeModel(kx=FOCAL_PX, ky=FOCAL_PX, px=511.5, py=511.5, n_rows=1024, n_cols=1024)

    class Fed(giant.EllipseMatching):
        """GIANT's estimator of points that are given."""

        def extract_and_pair_limbs(self, *_: Any) -> tuple[Array, ...]:
            return (np.zeros((3, POINTS)),) * 4 + (np.zeros((2, POINTS)),)

    options = giant.EllipseMatchingOptions(extraction_method=giant.LimbExtractionMethods.EDGE_DETECTION)
    light = giant.SceneObject(giant.Point([0.0, 0.0, -1e11]))
    errors: dict[str, list[Array]] = {"their": [], "our": []}
    chi = {"their": 0.0, "our": 0.0}
    apart = 0.0
    for _ in range(LIMBS):
        r_A = DISTANCE * _unit(rng.normal(size=3))
        C_CA = look_at(r_A, np.zeros(3), roll=float(rng.uniform(0.0, 6.0))).C_CA
        sights, truth = _limb(r_A, C_CA, float(rng.uniform(0.0, 2.0 * np.pi))), -C_CA @ r_A
        pixels = model.project_onto_image(sights.T) + EDGE_PX * rng.normal(size=(2, POINTS))
        body = giant.SceneObject(
            giant.Ellipsoid(principal_axes=AXES, orientation=C_CA),
            current_position=truth,
            current_orientation=np.eye(3),
        )
        theirs = Fed(giant.Scene(target_objs=[body], light_obj=light), giant.Camera(model=model), options=options)
        theirs.observed_bearings = [pixels]
        theirs.estimate(giant.OpNavImage(np.zeros((8, 8)), temperature=0.0))
        seen = model.pixels_to_unit(pixels).T
        ours = horizon_position(seen, C_CA @ np.diag(AXES**-2.0) @ C_CA.T, EDGE_PX / FOCAL_PX * seen[:, 2])
        for name, position, P in (
            ("their", theirs.observed_positions[0], theirs.details[0]["Covariance"]),
            ("our", -ours.r_C, ours.P),
        ):
            error = position - truth
            errors[name].append(error)
            chi[name] += float(error @ np.linalg.solve(P, error)) / 3.0 / LIMBS
        between = theirs.observed_positions[0] + ours.r_C
        apart += float(between @ np.linalg.solve(ours.P, between)) / 3.0 / LIMBS
    told = {"apart": apart**0.5, "their_chi": chi["their"], "our_chi": chi["our"]}
    for name, found in errors.items():
        squares = (np.array(found) ** 2).mean(axis=0)
        told |= {f"{name}_across": float(squares[:2].mean() ** 0.5), f"{name}_along": float(squares[2] ** 0.5)}
    return told


def _limb(r_A: Array, C_CA: Array, turn: float) -> Array:
    """Lines of sight to points where they touch the ellipsoid, in C, shape (POINTS, 3)."""
    scaled = r_A / AXES
    away = float(np.linalg.norm(scaled))
    u = scaled / away
    first = _unit(np.cross(u, [0.2, -0.4, 0.9]))
    angle = turn + np.radians(ARC_DEG) * (np.arange(POINTS) / POINTS - 0.5)
    ring = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * np.cross(u, first)
    touch = u / away + np.sqrt(1.0 - away**-2.0) * ring
    return np.asarray((touch * AXES - r_A) @ C_CA.T)


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--giant", type=Path, required=True)
    folder = parser.parse_args().giant
    giant, rng = giant_of(folder), np.random.default_rng(0)
    told = {"brown": brown(giant, rng), **laws(giant, rng), **horizons(giant, rng), "limbs": LIMBS}
    write_text(PAGE, TEXT.format(version="2.0.0", **told))


if __name__ == "__main__":
    main()
