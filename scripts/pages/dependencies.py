"""Write docs/results/dependencies.md, what swarm_mj stands on and under which licences: python -m scripts.pages.dependencies.

Requirements come from pyproject.toml, licences from the metadata of the packages that are installed. Run it where all extras
are: pip install -e ".[all,rl,benchmark]".
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from importlib.metadata import PackageMetadata, PackageNotFoundError, metadata, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from scripts.pages import RESULTS, ROOT
from swarm_mj.io.atomic import write_text

PAGE = RESULTS / "dependencies.md"
PROJECT = ROOT / "pyproject.toml"

#: What each declared package is for.
PURPOSE = {
    "mujoco": "the physics engine",
    "numpy": "arrays",
    "scipy": "integrators, the exact solver (HiGHS), sparse matrices, sampling",
    "numba": "compiled loops",
    "llvmlite": "functions of MuJoCo for compiled loops",
    "trimesh": "the PLY reader, glTF scenes",
    "embreex": "ray casting (Embree)",
    "moderngl": "face-ID buffers on OpenGL",
    "gymnasium": "the environment's interface",
    "matplotlib": "figures",
    "pydantic": "checks of scenario files",
    "annotated-types": "bounds of scenario keys, as pydantic keeps them",
    "docstring-parser": "arguments of plug-ins explained",
    "pyyaml": "scenario files",
    "xarray": "telemetry with units",
    "pandas": "tables of the public API",
    "h5netcdf": "telemetry.nc",
    "h5py": "telemetry.nc",
    "pyerfa": "turning of Earth and leap seconds",
    "rich": "progress bars and tables",
    "pymoo": "the genetic algorithm",
    "pettingzoo": "the multi-agent environment's interface",
    "av": "videos (FFmpeg)",
    "pillow": "pictures and films",
    "scikit-image": "landmarks in pictures by normalised correlation",
    "pygame": "the window of the environment",
    "plotly": "figures of the report page",
    "stable-baselines3": "training of the baselines",
    "onnxruntime": "scores of policies in ONNX files",
    "sb3-contrib": "policies with masks, trained and scored",
    "tensorboard": "curves of the training",
    "distributed": "campaigns on a Dask cluster",
    "pyarrow": "tables of campaigns (Parquet)",
    "bsk": "the comparison with Basilisk",
    "orekit-jcc": "the comparison with Orekit",
    "spiceypy": "SPICE kernels, out and in",
    "rasterio": "maps as GeoTIFF",
    "oem": "tests: reading exported OEM",
    "ccsds-ndm": "tests: reading exported OEM and AEM 1.0",
    "brahe": "tests: reading exported OEM and AEM 2.0; the comparison with brahe",
    "pytest": "tests",
    "pytest-xdist": "tests in parallel",
    "hypothesis": "tests of properties and bad input",
    "selenium": "tests: the report in a browser",
    "shapely": "tests: exact areas of polygons",
    "astropy": "pictures as FITS; tests: ephemerides",
    "mitsuba": "the comparison of pictures with another renderer",
    "jsonschema": "tests: the JSON schema of scenario files",
    "polyhedral-gravity": "tests: gravity of polyhedra",
    "ruff": "style",
    "mypy": "types",
    "pre-commit": "checks before a commit",
    "build": "the wheel",
    "types-pyyaml": "types",
    "mkdocs": "the site",
    "mkdocs-material": "the site's look and search",
    "mkdocstrings": "the site's API reference",
    "nbclient": "running notebooks and pages",
    "nbformat": "reading notebooks",
    "ipykernel": "running notebooks and pages",
    "latex2mathml": "formulas of the site",
    "pip-audit": "known vulnerabilities",
}
GROUPS = {
    "": "Always installed",
    "rl": "Extra `rl`: reinforcement learning",
    "cluster": "Extra `cluster`: campaigns on many machines",
    "benchmark": "Extra `benchmark`: comparison with peers",
    "agreement": "Extra `agreement`: flights in other programs",
    "spice": "Extra `spice`: SPICE kernels",
    "fits": "Extra `fits`: pictures as FITS",
    "reference": "Extra `reference`: pictures of another renderer",
    "dev": "Extra `dev`: development only, never imported by a flight",
    "docs": "Extra `docs`: the site, its examples and notebooks",
}
#: Licences that do not state their name, by a sentence of theirs.
SENTENCES = {
    "Redistribution and use in source and binary forms": "BSD",
    "Permission is hereby granted, free of charge": "MIT",
    "Apache License": "Apache-2.0",
}
INTRODUCTION = """# Dependencies

Written by `python -m scripts.pages.dependencies` from `pyproject.toml` and the metadata of the installed packages. swarm_mj
itself is under the MIT licence.

Lower bounds are the oldest versions with what is used here. There is one upper bound, on the next major version of mujoco,
which may change what a step computes; others would keep security fixes away from users. Nothing asks for a network at run
time; a test refuses every connection while it flies, draws and designs (`tests/robustness/test_offline.py`).

`make audit` looks for known vulnerabilities of everything that is installed: it runs `pip-audit`, which it installs into the
virtual environment, against pypi.org or, failing that, api.osv.dev. Where neither can be reached it says that nothing was
checked and ends with an error; the tests and the other checks do without.

Some licences ask for more than the others: `moocore`, which pymoo brings along, and `pygame`, which opens a window, are under
the LGPL and are used as they are, as libraries; the wheels of `av` carry FFmpeg under the LGPL with the encoders x264 and x265
under the GPL, which films are written by; `polyhedral-gravity`, under the GPL, belongs to the tests, and `swarm-mj validate`
uses it where it is installed; `ccsds-ndm`, under the GPL too, and `hypothesis`, under the MPL, belong to the tests alone.
"""


def main() -> None:
    """Write the page."""
    write_text(PAGE, page())
    print(f"wrote {PAGE}")


def page() -> str:
    """The whole page as Markdown."""
    parts = [INTRODUCTION]
    for group, requirements in declared().items():
        if requirements:
            parts.append(f"## {GROUPS.get(group, f'Extra `{group}`')}\n\n{_table(requirements)}")
    direct = {canonicalize_name(r.name) for group in declared().values() for r in group}
    parts.append(
        "## What the always installed ones bring along\n\n"
        "| package | licence |\n|---|---|\n"
        + "\n".join(f"| {name} | {licence(name)} |" for name in sorted(brought_along(declared()[""]) - direct))
        + "\n"
    )
    return "\n".join(parts)


def declared() -> dict[str, list[Requirement]]:
    """The requirements of pyproject.toml by extra; the empty name stands for those that are always installed."""
    project = tomllib.loads(PROJECT.read_text("utf-8"))["project"]
    groups = {"": project["dependencies"], **project["optional-dependencies"]}
    own = canonicalize_name(project["name"])
    return {
        group: [r for r in map(Requirement, texts) if canonicalize_name(r.name) != own]
        for group, texts in groups.items()
    }


def _table(requirements: Iterable[Requirement]) -> str:
    rows = ["| package | versions | licence | what for |", "|---|---|---|---|"]
    for r in requirements:
        bounds = ",".join(sorted(map(str, r.specifier), reverse=True))  # the lower one first
        versions = f"{bounds or 'any'}" + (f", where {r.marker}" if r.marker else "")
        purpose = PURPOSE.get(canonicalize_name(r.name))
        if purpose is None:
            raise SystemExit(f"{r.name}: say in PURPOSE of {Path(__file__).name} what it is for")
        rows.append(f"| {r.name} | {versions} | {licence(r.name)} | {purpose} |")
    return "\n".join(rows) + "\n"


def licence(name: str) -> str:
    """The licence that a package's metadata states."""
    try:
        data = metadata(name)
    except PackageNotFoundError:
        return "not installed where this page was written"
    return _stated(data) or "not stated"


def _stated(data: PackageMetadata) -> str:
    if data["License-Expression"]:
        return str(data["License-Expression"])
    classified = [
        c.split(" :: ")[-1] for c in data.get_all("Classifier") or [] if c.startswith("License :: OSI Approved ::")
    ]
    if classified:
        return ", ".join(classified)
    text = str(data["License"] or "").strip()
    if "\n" not in text:
        return text
    return next(
        (name for sentence, name in SENTENCES.items() if sentence in re.sub(r"\s+", " ", text)), text.split("\n")[0]
    )


def brought_along(requirements: Iterable[Requirement]) -> set[str]:
    """Names of the packages that installing these installs too, on this machine, the given ones included."""
    found: set[str] = set()
    waiting = list(requirements)
    while waiting:
        requirement = waiting.pop()
        name = canonicalize_name(requirement.name)
        if name in found or (requirement.marker and not requirement.marker.evaluate({"extra": ""})):
            continue
        try:
            waiting.extend(map(Requirement, requires(name) or []))
        except PackageNotFoundError:
            continue
        found.add(name)
    return found


if __name__ == "__main__":
    main()
