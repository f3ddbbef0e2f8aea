"""The pictures of a run written: counts as PNG or FITS, labels of every pixel, and what a reader of them must know."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from swarm_mj import __version__
from swarm_mj.errors import InteropError
from swarm_mj.flight.observe import arrival_samples, flight_pictures
from swarm_mj.flight.pictures import PictureMaker
from swarm_mj.interop.export import chosen_formats, files_in, written_into
from swarm_mj.interop.states import FlightStates
from swarm_mj.io.interruption import check
from swarm_mj.observation.capture import Picture
from swarm_mj.observation.detector import Exposed
from swarm_mj.observation.raycast import RayTracer
from swarm_mj.observation.shading import Labels

#: What lists the files; only a folder that has it is written again.
MANIFEST: Final = "images.json"
FORMATS: Final = ("png", "fits")
#: Labels of a pixel: type, unit and meaning, in the order of their arrays.
LABELS: Final[dict[str, tuple[str, str, str]]] = {
    "face": ("int32", "1", "number of the face of the body's mesh, -1: sky"),
    "depth": ("float32", "m", "distance along the axis of the camera, Z in C, 0: sky"),
    "normal": ("float32", "1", "outward unit normal in A, three components, 0: sky"),
    "incidence": ("float32", "deg", "angle between normal and Sun, NaN: sky"),
    "emission": ("float32", "deg", "angle between normal and camera, NaN: sky"),
    "phase": ("float32", "deg", "angle between Sun and camera, NaN: sky"),
    "lit": ("bool", "1", "whether the Sun shines on it, shadows cast by the body included"),
    "target": ("bool", "1", "whether the face reaches into the target"),
}


def write_images(
    states: FlightStates,
    folder: Path,
    formats: Iterable[str] = ("png",),
    *,
    labels: bool = True,
    every_s: float | None = None,
    spacecraft: Iterable[int] | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Path]:
    """Write pictures of a run into a folder that is made if need be; gives the files.

    Args:
        states: Of the flight.
        folder: Where; earlier images are replaced, other files are kept.
        formats: `png` (16 bit), `fits`, or `all`.
        labels: Whether to write the labels of each picture, see `LABELS`.
        every_s: Least time between two pictures of a spacecraft [s]; None: all by which the scenario's criterion judges.
        spacecraft: Whose, from 1; None: everybody's.
        progress: Called with the number of pictures written.

    Raises:
        InteropError: A format is unknown or needs a package that is not installed, or there is no such spacecraft or picture.
        OutputError: The folder cannot be written or holds something else.
        ScenarioError: It is not known how the body reflects light.
    """
    chosen = chosen_formats(formats, FORMATS)
    fits = _astropy_fits() if "fits" in chosen else None
    who = _chosen_spacecraft(states, spacecraft)
    maker = PictureMaker(states.plan)
    target = _faces_of_target(states)
    with written_into(Path(folder), MANIFEST) as (partial, files):
        rows: list[dict[str, Any]] = []
        for picture in chosen_pictures(states, every_s, who):
            check()
            exposed = maker.take(picture)
            told = described(picture, exposed)
            stem = f"sc{picture.spacecraft + 1}/t{picture.t:09.2f}s"
            (partial / stem).parent.mkdir(exist_ok=True)
            found = maker.labels(picture) if labels else None
            layers = {} if found is None else _layers(found, target)
            if "png" in chosen:
                Image.fromarray(exposed.counts).save(partial / f"{stem}.png")
                if layers:
                    np.savez_compressed(partial / f"{stem}.npz", **layers)  # type: ignore[arg-type]
            if fits is not None:
                _write_fits(fits, partial / f"{stem}.fits", exposed.counts, told, layers)
            rows.append({"file": stem, **told})
            if progress is not None:
                progress(len(rows))
        if not rows:
            raise InteropError(
                "no picture was taken that the scenario's criterion judges; give every_s for all of the passage"
            )
        (partial / "README.md").write_text(_card(states, maker, chosen, rows, labels), "utf-8")
        contents = {
            "program": f"swarm_mj {__version__}",
            "scenario": states.plan.scenario.name,
            "body": states.plan.scenario.body.name,
            "formats": chosen,
            "frames": "A: body-fixed, z along the spin axis; C: camera, z along the line of sight, x right, y down",
            "lens": {**maker.lens._asdict(), "distortion": maker.lens.distortion._asdict()},
            "labels": {name: dict(zip(("type", "unit", "meaning"), of, strict=True)) for name, of in LABELS.items()}
            if labels
            else {},
            "pictures": rows,
            "files": files_in(partial),
        }
        (partial / MANIFEST).write_text(json.dumps(contents, indent=1) + "\n", "utf-8")
    return files


def chosen_pictures(states: FlightStates, every_s: float | None, who: set[int]) -> Iterator[Picture]:
    """Pictures by which the criterion judges; or of the whole passage, no two of a spacecraft nearer in time than `every_s`."""
    plan, last = states.plan, dict[int, float]()
    arrivals = states.telemetry["time"].values[arrival_samples(plan.scenario)]
    arrival_only = plan.scenario.observation.criterion == "arrival" and every_s is None
    for picture in flight_pictures(plan, states.telemetry):
        j = picture.spacecraft
        at_arrival = j < len(arrivals) and picture.t == arrivals[j]
        due = picture.t - last.get(j, -np.inf) >= (every_s or 0.0) - 1e-9
        if j in who and (at_arrival or (due and not arrival_only)):
            last[j] = picture.t
            yield picture


def described(picture: Picture, exposed: Exposed) -> dict[str, Any]:
    """What the manifest and the FITS header tell of a picture."""
    return {
        "spacecraft": picture.spacecraft + 1,
        "t_s": picture.t,
        "exposure_s": exposed.exposure_s,
        "r_A_m": picture.r_A.tolist(),
        "C_CA": picture.C_CA.tolist(),
        "sun_A_m": np.asarray(picture.sun_A, np.float64).tolist(),
        "gain_e_dn": exposed.gain,
        "bias_dn": exposed.bias,
        "dark_e": exposed.dark_e,
        "read_noise_e": exposed.read_noise_e,
        "electrons_per_radiance_factor": exposed.electrons_per_factor,
        "saturated_px": int(exposed.saturated.sum()),
    }


def _layers(found: Labels, target: NDArray[Any]) -> dict[str, NDArray[Any]]:
    layers = {name: np.asarray(getattr(found, name), LABELS[name][0]) for name in LABELS if name != "target"}
    layers["target"] = (found.face >= 0) & np.append(target, False)[np.minimum(found.face, len(target))]
    return layers


def _faces_of_target(states: FlightStates) -> NDArray[Any]:
    """Faces of the body's own mesh that reach into the target, shape (f,)."""
    region, shape = states.plan.region, states.plan.shape
    inside = np.zeros(len(shape.faces), np.bool_)
    tracer = RayTracer(shape.vertices, shape.faces)
    start = region.centroid_A + 1e-3 * np.sqrt(region.typical_area) * region.normal_A
    hit = tracer.first_hit(start, -region.normal_A)
    inside[hit[hit >= 0]] = True
    return inside


def _chosen_spacecraft(states: FlightStates, asked: Iterable[int] | None) -> set[int]:
    n = states.plan.n_observers
    if asked is None:
        return set(range(n))
    chosen = set(asked)
    if wrong := sorted(one for one in chosen if not 1 <= one <= n):
        raise InteropError(f"spacecraft = {wrong[0]}: must be one of 1 to {n}, those that observe")
    return {one - 1 for one in chosen}


def _astropy_fits() -> Any:
    try:
        from astropy.io import fits
    except ImportError:
        raise InteropError("FITS needs astropy, which is not installed: pip install 'swarm_mj[fits]'") from None
    return fits


def _write_fits(
    fits: Any, path: Path, counts: NDArray[np.uint16], told: dict[str, Any], layers: dict[str, NDArray[Any]]
) -> None:
    """Counts as the primary image, its rows upwards as FITS has them, and a compressed extension for each label."""
    primary = fits.PrimaryHDU(counts[::-1])
    header = primary.header
    header["BUNIT"], header["EXPTIME"], header["GAIN"] = (
        "DN",
        (told["exposure_s"], "[s]"),
        (told["gain_e_dn"], "[e/DN]"),
    )
    header["BIAS"], header["RDNOISE"] = (told["bias_dn"], "[DN]"), (told["read_noise_e"], "[e] rms")
    header["SPACECR"], header["T"] = told["spacecraft"], (told["t_s"], "past the epoch, TDB [s]")
    header["IOVERF"] = (told["electrons_per_radiance_factor"], "[e] of a radiance factor of 1")
    for key, values in (("R_A", told["r_A_m"]), ("SUN_A", told["sun_A_m"])):
        for k, value in enumerate(values):
            header[f"{key}{k + 1}"] = (value, "[m] in A")
    for i, row in enumerate(told["C_CA"]):
        for k, value in enumerate(row):
            header[f"C_CA{i + 1}{k + 1}"] = (value, "rotation from A to C")
    units = [fits.ImageHDU(_for_fits(layer), name=name.upper()) for name, layer in layers.items()]
    fits.HDUList([primary, *units]).writeto(path)


def _for_fits(layer: NDArray[Any]) -> NDArray[Any]:
    upwards = layer[::-1]
    if layer.ndim == 3:
        upwards = np.moveaxis(upwards, -1, 0)
    return upwards.astype(np.uint8) if layer.dtype == np.bool_ else np.ascontiguousarray(upwards)


def _card(
    states: FlightStates, maker: PictureMaker, chosen: list[str], rows: list[dict[str, Any]], labels: bool
) -> str:
    """The card of the data set."""
    scenario, lens = states.plan.scenario, maker.lens
    told = "\n".join(f"| `{name}` | {kind} | {unit} | {meaning} |" for name, (kind, unit, meaning) in LABELS.items())
    table = f"| label | type | unit | meaning |\n|---|---|---|---|\n{told}\n" if labels else "No labels were written.\n"
    law = scenario.body.reflectance
    assert law is not None  # pictures were made
    return f"""# Pictures of {scenario.body.name}

Made by swarm_mj {__version__} from the flight {scenario.name}: {len(rows)} pictures of {lens.width} x {lens.height} pixels,
{" and ".join(chosen)}, by {len({row["spacecraft"] for row in rows})} spacecraft.

- `{MANIFEST}`: one entry a picture with its time, pose, Sun, exposure and gain; lens; labels; all files.
- `scJ/tT.png`: counts [DN] of the converter in 16 bit, which viewers show dark: stretch them; row 0 on top.
- `scJ/tT.npz`: labels of the same pixels.
- `scJ/tT.fits`: counts and labels as extensions, row 0 at the bottom.

Pixel (row i, column j) covers i to i + 1 and j to j + 1, counted from the upper left corner; labels hold at its centre.
Light: {law.law}, sunlight and cast shadows; no light from face to face, no stars, no stray light, nothing finer than the mesh.

{table}
To read it with torch:

```python
import json
import numpy as np
import torch
from PIL import Image

class Pictures(torch.utils.data.Dataset):
    def __init__(self, folder):
        self.folder, self.rows = folder, json.load(open(f"{{folder}}/{MANIFEST}"))["pictures"]
    def __len__(self):
        return len(self.rows)
    def __getitem__(self, k):
        row = self.rows[k]
        counts = torch.from_numpy(np.array(Image.open(f"{{self.folder}}/{{row['file']}}.png"), np.int32))
        labels = dict(np.load(f"{{self.folder}}/{{row['file']}}.npz"))
        return counts, {{name: torch.from_numpy(of) for name, of in labels.items()}}, torch.tensor(row["r_A_m"])
```
"""
