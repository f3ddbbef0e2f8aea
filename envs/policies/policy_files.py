"""Policy files of SwarmObserve-v0: networks of swarm_mj (`.npz`), ONNX (`.onnx`) and stable-baselines3 (`.zip`).

Each tells what it was trained for, and is refused by name where that is not what it flies in. Observations of this environment
are told in the target's own frame and scales, so that no file holds the geometry of a body.

Policies that were trained with `candidates` are told so by their file, and fly everywhere: what they choose among is worked
out from the tables.

An ONNX model has an input `observation` of float32, shape (E, F), and, if it likes, `action_mask`, shape (E, n, C), of float32
or bool; its first output is either choices, integers of shape (E, n), or logits, n C numbers for each of E. Its metadata may
hold `swarm_mj`, JSON of `Provenance`. A zip of stable-baselines3 may hold the same as `swarm_mj.json`. Reading a zip executes
what is pickled in it: open only those that you trust.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
from gymnasium import Space
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from numpy.typing import NDArray

from swarm_mj import __version__
from swarm_mj.errors import ScenarioError, SwarmError
from swarm_mj.io.arrays import check_archive
from swarm_mj.io.records import reading, record_from, require_file
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array32, Ints

from ..observe.config import EnvConfig, checked_candidates
from ..observe.layout import CHOICE_SIZE, AllPatches, Interface, Observed, choice_rows, local_rows, make_interface
from ..observe.single import NAME
from ..observe.tables import GENERAL, PAIRS, PATCHES, SPACECRAFT
from .baselines import Policy
from .policy_network import MAX_POLICY_BYTES, NetworkPolicy, Provenance, load_network, masked_argmax

#: The trained policy that travels with the package.
PACKAGED = "policies/swarm-observe.npz"
#: Raise when what stands where in an observation, or its scale, changes.
LAYOUT = 3
#: What changes the meaning of an observation or a choice; a network that reads a choice does not care for the first two.
MEANING = ("spacecraft", "patches", "decision_s")
#: Kinds of files by their endings.
ENDINGS = (".npz", ".onnx", ".zip")
#: Where a zip of stable-baselines3 keeps what it was trained for.
MEMBER = "swarm_mj.json"
REMEDY = "give a zip that PPO of stable-baselines3, or MaskablePPO of sb3-contrib, saved"
TELL = (
    "it does not tell what it was trained for: tell_in_zip(file, EnvConfig(...)) of swarm_mj.envs.policies.policy_files adds "
    "that, candidates too"
)


class ZipAbout(Provenance):
    """What a zip of stable-baselines3 tells of its policy.

    Attributes:
        reads: What it is shown at once: all, or what each spacecraft is told.
    """

    reads: Literal["swarm", "spacecraft"] = "swarm"


def flat_rows(observed: Observed) -> Array32:
    """The flat observation from the tables by name, shape (E, F)."""
    n, patches = observed["pairs"].shape[1:3]
    return AllPatches(n, patches).flat(observed)


def provenance(config: EnvConfig) -> dict[str, Any]:
    """What a file should tell of a policy trained now in an environment of these arguments, in values that JSON has."""
    given = {item.name: getattr(config, item.name) for item in fields(config)}
    # What others mean without being asked may change from version to version.
    told = {item.name: given[item.name] for item in fields(config) if given[item.name] != item.default}
    told |= {name: getattr(config, name) for name in MEANING}
    plain = json.loads(json.dumps(told, default=lambda one: one.name if isinstance(one, Scenario) else str(one)))
    return {"environment": NAME, "arguments": plain, "layout": LAYOUT, "package": __version__}


def check(about: Mapping[str, Any], config: EnvConfig, policy: str = "policy") -> None:
    """Refuse a policy whose observations or choices mean something else in an environment of these arguments.

    What its file does not tell, `about`, passes.

    Raises:
        ScenarioError: The message names what differs.
    """
    environment, layout, told = (
        about.get("environment") or NAME,
        about.get("layout", LAYOUT),
        about.get("arguments", {}),
    )
    if environment != NAME:
        raise ScenarioError(
            f"{policy}: trained for environment = {environment!r}, but it is {NAME!r} here; fly it in {environment} or train "
            f"one for {NAME}"
        )
    if layout != LAYOUT:
        written = about.get("package") or "an older version"
        raise ScenarioError(
            f"{policy}: trained for layout = {layout} of the observation (swarm_mj {written}), but it is {LAYOUT} here "
            f"(swarm_mj {__version__}); train it anew"
        )
    for name in MEANING[2:] if about.get("reads") == "choice" else MEANING:
        here = getattr(config, name)
        trained = told.get(name, here)
        if trained != here:
            raise ScenarioError(
                f"{policy}: trained for {name} = {trained!r}, but it is {here!r} here; train one for that"
            )
    try:
        checked_candidates(told.get("candidates"), config.patches)
    except ScenarioError as error:
        raise ScenarioError(f"{policy}: trained for {error}") from None


def told_arguments(file: str | Path) -> dict[str, Any]:
    """The arguments of the environment that a policy was trained in, as its file tells; empty where it does not.

    Raises:
        ScenarioError: The file cannot be read.
    """
    path = Path(file)
    if path.suffix == ".npz":
        return dict(load_network(path).about.get("arguments", {}))
    if path.suffix == ".zip":
        return dict(_zip_about(path)[0].get("arguments", {}))
    return {}


def interface_of(about: Mapping[str, Any], config: EnvConfig) -> Interface:
    """What a policy was shown and chose among as it was trained; where it does not tell, all patches."""
    return make_interface(config.spacecraft, config.patches, about.get("arguments", {}).get("candidates"))


def policy_file(what: str, file: str | Path, names: Iterable[str], error: type[SwarmError] = ScenarioError) -> Path:
    """The file of a policy, in messages called `what`, that has none of these names.

    Raises:
        SwarmError: As `error`; it is not there, or no regular file of a policy's size.
    """
    path = Path(file)
    try:
        require_file(path, MAX_POLICY_BYTES)
    except (OSError, ValueError) as reason:
        raise error(f"{what} {str(path)!r}: {reason}, and no name; names are {', '.join(names)}") from None
    return path


def open_policy(file: str | Path, config: EnvConfig) -> Policy:
    """The policy of a file, to be flown in an environment of these arguments.

    Raises:
        ScenarioError: The file cannot be read, or its policy is for something else; the message names what.
    """
    path = Path(file)
    if path.suffix not in ENDINGS:
        raise ScenarioError(f"policy {path}: must end in one of {', '.join(ENDINGS)}")
    with reading(f"policy {path}", "give the file of a policy", ScenarioError):
        require_file(path, MAX_POLICY_BYTES)
    openers = {".npz": _network, ".onnx": _onnx, ".zip": _sb3}
    return openers[path.suffix](path, config)


def sizes(config: EnvConfig) -> tuple[int, int, int]:
    """Numbers of a flat observation and of what one agent is shown, and choices of a spacecraft."""
    n, patches = config.spacecraft, config.patches
    local = n * len(SPACECRAFT) + patches * (len(PAIRS) + len(PATCHES)) + len(GENERAL)
    return AllPatches(n, patches).layout.size, local, patches + 1 + n


def network_policy(network: NetworkPolicy) -> Policy:
    """A network as a policy that reads tables by name."""
    rows = {"swarm": flat_rows, "spacecraft": local_rows, "choice": choice_rows}[network.about["reads"]]

    def choose(observed: Observed) -> Ints:
        return network.act(rows(observed), observed["action_mask"])

    return choose


def _network(path: Path, config: EnvConfig) -> Policy:
    network = load_network(path)
    about = network.about
    check(about, config, f"policy {path}")
    flat, local, choices = sizes(config)
    shown = {"swarm": flat, "spacecraft": local, "choice": CHOICE_SIZE}
    if about["reads"] != "choice":
        _fits(path, "choices of each spacecraft", about["choices"], choices, about)
        _fits(path, "spacecraft", about["spacecraft"], config.spacecraft, about)
    _fits(path, "numbers of an observation", network.readings, shown[about["reads"]], about)
    return network_policy(network)


def _onnx(path: Path, config: EnvConfig) -> Policy:
    try:
        import onnxruntime
    except ImportError:
        raise ScenarioError(f"policy {path}: needs the extra onnx: pip install 'swarm_mj[onnx]'") from None
    with reading(f"policy {path}", "give a model that ONNX Runtime can run", ScenarioError):
        session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
        told = session.get_modelmeta().custom_metadata_map.get("swarm_mj")
        about = record_from(told, Provenance) if told else {}
    check(about, config, f"policy {path}")
    inputs = {item.name: item for item in session.get_inputs()}
    if "observation" not in inputs or set(inputs) - {"observation", "action_mask"}:
        raise ScenarioError(
            f"policy {path}: inputs {', '.join(inputs)}: must be observation and, if it likes, action_mask"
        )
    interface = interface_of(about, config)
    _fits(path, "numbers of an observation", inputs["observation"].shape[-1], interface.layout.size, about)
    mask_type = np.bool_ if "action_mask" in inputs and "bool" in inputs["action_mask"].type else np.float32

    def choose(observed: Observed) -> Ints:
        mask = interface.shown(observed)["action_mask"]
        fed: dict[str, NDArray[Any]] = {"observation": interface.flat(observed)}
        if "action_mask" in inputs:
            fed["action_mask"] = mask.astype(mask_type)
        return interface.decoded(observed, _chosen(path, np.asarray(session.run(None, fed)[0]), mask))

    return choose


def _sb3(path: Path, config: EnvConfig) -> Policy:
    about, masked = _zip_about(path)
    check(about, config, f"policy {path}")
    algorithm = _algorithm(path, masked)
    with reading(f"policy {path}", REMEDY, ScenarioError):
        model = algorithm.load(path, device="cpu")
    interface, n = interface_of(about, config), config.spacecraft
    shared = about.get("reads") == "spacecraft"
    nothing = interface.layout.split(np.zeros(interface.layout.size, np.float32))
    shown = local_rows(nothing).shape[2] if shared else interface.layout.size
    _made_of(path, "observations", model.observation_space, Box)
    _fits(path, "numbers of an observation", model.observation_space.shape[-1], shown, about)
    space = _made_of(path, "choices", model.action_space, Discrete if shared else MultiDiscrete)
    choices = [int(space.n)] * n if shared else space.nvec.tolist()
    _fits(path, "choices", choices, [interface.choices] * n, about)

    def choose(observed: Observed) -> Ints:
        rows = interface.flat(observed)
        if shared:
            rows = local_rows(interface.layout.split(rows)).reshape(-1, shown)
        mask = {"action_masks": interface.shown(observed)["action_mask"].reshape(len(rows), -1)} if masked else {}
        return interface.decoded(observed, model.predict(rows, deterministic=True, **mask)[0].reshape(-1, n))

    return choose


def _zip_about(path: Path) -> tuple[dict[str, Any], bool]:
    """What a zip tells of its policy, and whether that takes masks."""
    with reading(f"policy {path}", REMEDY, ScenarioError):
        check_archive(path, MAX_POLICY_BYTES)
    with reading(f"policy {path}", REMEDY, ScenarioError), zipfile.ZipFile(path) as archive:
        about = record_from(archive.read(MEMBER), ZipAbout) if MEMBER in archive.namelist() else {}
        return about, "data" in archive.namelist() and b"sb3_contrib.common.maskable" in archive.read("data")


def _algorithm(path: Path, masked: bool) -> Any:
    """What reads a zip."""
    try:
        from stable_baselines3 import PPO

        if masked:
            from sb3_contrib import MaskablePPO
    except ImportError as error:
        raise ScenarioError(f"policy {path}: needs {error.name}: pip install 'swarm_mj[rl]'") from None
    return MaskablePPO if masked else PPO


def tell_in_zip(path: str | Path, config: EnvConfig, reads: Literal["swarm", "spacecraft"] = "swarm") -> None:
    """Add to what `PPO.save` wrote the arguments of the environment it was trained in, and what it reads, see `ZipAbout`."""
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(MEMBER, json.dumps(provenance(config) | {"reads": reads}, sort_keys=True))


def _chosen(path: Path, out: NDArray[Any], mask: NDArray[Any]) -> Ints:
    if out.dtype.kind in "iu" and out.shape == mask.shape[:2]:
        return out.astype(np.int64)
    if out.dtype.kind == "f" and out.size == mask.size:
        return masked_argmax(out.reshape(mask.shape), mask)
    raise ScenarioError(
        f"policy {path}: its output of type {out.dtype} and shape {out.shape} must be integers of shape {mask.shape[:2]} or "
        f"logits of shape {mask.shape}"
    )


def _fits(path: Path, what: str, found: Any, must: Any, about: Mapping[str, Any]) -> None:
    # ONNX gives names to sizes that are left open.
    if found != must and not isinstance(found, str):
        remedy = TELL if path.suffix == ".zip" and not about else "fly what it was trained for"
        raise ScenarioError(f"policy {path}: {what} = {found}, must be {must} here; {remedy}")


def _made_of(path: Path, what: str, space: Any, kind: type[Space[Any]]) -> Any:
    """A space of a policy, if it is of that kind."""
    if not isinstance(space, kind):
        raise ScenarioError(
            f"policy {path}: space of its {what} = {type(space).__name__}, must be {kind.__name__} here; train one on the "
            "observation `flat`"
        )
    return space
