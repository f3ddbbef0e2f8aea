"""What of the flight's pictures reaches Earth: the data of a flight, its contacts afterwards, and two ways to send them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from swarm_mj.dataflow.contacts import Contacts, Instants, find_contacts, radios_from, samples_of
from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.dataflow.ground import earth_schedule
from swarm_mj.dataflow.network import EARTH, Access, Network
from swarm_mj.dataflow.online import ON_EARTH, SPACECRAFT_LOST, STORAGE_FULL, Account, run_online
from swarm_mj.dataflow.optimum import SAME, earliest_full, optimum
from swarm_mj.dataflow.radios import radio_from
from swarm_mj.dataflow.tiles import Tiles, make_tiles
from swarm_mj.dataflow.time_expanded_program import reachable_value
from swarm_mj.errors import MissionError
from swarm_mj.flight.coordination import acts_alone, crosslinks_left
from swarm_mj.flight.observe import camera_from, flown_cameras
from swarm_mj.flight.plan import Plan
from swarm_mj.flight.post_flight import (
    Course,
    elect_relays,
    flown_instants,
    joined,
    less_pointing,
    post_flight_instants,
    post_flight_paths,
)
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraPose
from swarm_mj.observation.capture import limits_of, pixels_on, sight
from swarm_mj.observation.coverage import KeptPictures
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.smallbody.companion import Companion
from swarm_mj.smallbody.occultation import occluder_of
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.typing import Array, Ints, Mask

#: Instants of a slot at which its contacts are looked at, at least and at most, and the time between them that is aimed at [s].
FEWEST_SAMPLES, MOST_SAMPLES, SAMPLE_S = 4, 80, 15.0
#: Slots while pictures are taken, at most: beyond, slots grow longer than data.slot_s.
MAX_IMAGING_SLOTS = 200
#: After the imaging slots grow from one to the next, up to the longest [s]: what changes later changes slowly.
GROWTH, LONGEST_SLOT_S = 1.05, 1800.0
#: Spacecraft for which contacts are computed, and links times slots that are held at once, at most.
MOST_SPACECRAFT, MOST_LINKS = 200, 20_000_000
#: Spacecraft above which the proven optimum leaves out crosslinks but those to relays and to this many neighbours.
ALL_LINKS, NEIGHBOURS = 12, 3
#: Time after which the best schedule is left unproven [s].
PROOF_S = 60.0


def deliver(plan: Plan, telemetry: xr.Dataset, kept: KeptPictures, *, prove: bool = True) -> Delivery | None:
    """Send what a flight saw to Earth: by what the swarm can run alone, and by the schedule that is proven best.

    Args:
        plan: What was flown.
        telemetry: The flight.
        kept: By which pictures what it saw is kept.
        prove: Whether to find the best schedule; without, its arrays hold NaN.

    Returns:
        None for more than `MOST_SPACECRAFT`, whose contacts fill the memory.

    Raises:
        ScenarioError: A radio or network does not exist.
    """
    scenario = plan.scenario
    if plan.n > MOST_SPACECRAFT:
        return None
    tiles = tiles_of(plan, telemetry, kept)
    edges_s = slot_edges(scenario, tiles.ready_s, MOST_LINKS // plan.n**2)
    swarm = SampledSwarm.of_flight(plan, telemetry, edges_s)
    trials = Trials(swarm, tiles)
    elections = elect_relays(scenario, telemetry, swarm.course, edges_s, trials.value, trials.bound)
    instants = swarm.instants(elections.relays_at(swarm.course.t))
    contacts = swarm.contacts(instants)
    network = network_of(scenario, tiles, contacts, instants)
    relaxed = network_of(scenario, tiles, contacts, instants, continuous=True)
    speaks = speaking(instants, network.n_slots)
    account = run_online(network, speaks, shared=not acts_alone(scenario.swarm))
    delivered = _delivered(network, account, contacts.light_time_s)
    return Delivery(
        **_geometry(contacts, speaks),
        **_held(tiles),
        **delivered,
        **(_best(network, relaxed, account, contacts, delivered) if prove else _unproven(network)),
        election_s=elections.time_s,
        elected=elections.elected,
    )


def _neighbours(network: Network) -> int | None:
    return NEIGHBOURS if network.n_spacecraft > ALL_LINKS else None


def _best(
    network: Network, relaxed: Network, account: Account, contacts: Contacts, delivered: dict[str, Any]
) -> dict[str, Any]:
    """The best schedule and, where all that was seen arrives, its earliest time; unproven after `PROOF_S`."""
    neighbours = _neighbours(network)
    complete = bool((account.delivered_slot < network.n_slots).all()) and network.n_tiles > 0
    # Nothing can be better than all that was seen: later slots need not be looked at where that arrives before.
    window = network.until(int(account.delivered_slot.max()) + 1) if complete else network
    try:
        best = optimum(window, neighbours=neighbours, time_limit_s=PROOF_S)
        earliest = earliest_full(window, neighbours=neighbours).n_slots if complete else 0
        bound = network.seen_value
        if not complete:
            bound = optimum(relaxed, neighbours=neighbours, time_limit_s=PROOF_S).bound
    except MissionError:
        return _unproven(network)
    earth_bit, share = np.zeros(network.earth_bit.shape), best.delivered_share
    earth_bit[: window.n_slots] = best.earth_bit
    if account.value >= best.value * (1.0 - SAME) and not complete:
        # Of equal schedules the program gives any, however late; what was flown is one of them.
        arrives = account.delivered_slot < network.n_slots
        earth_bit, share = delivered["earth_bit"].astype(np.float64), arrives.astype(np.float64)
    full_s = contacts.edges_s[earliest] + contacts.light_time_s[earliest - 1] if earliest else np.nan
    return {
        "best_earth_bit": earth_bit,
        "best_share": share,
        "best_full_s": np.array(full_s),
        "best_bound_area": np.array(min(bound, network.seen_value)),
    }


def _unproven(network: Network) -> dict[str, Any]:
    return {
        "best_earth_bit": np.full(network.earth_bit.shape, np.nan),
        "best_share": np.full(network.n_tiles, np.nan),
        "best_full_s": np.array(np.nan),
        "best_bound_area": np.array(np.nan),
    }


def _geometry(contacts: Contacts, speaks: Mask) -> dict[str, Any]:
    speakers = np.where(speaks[:, None, :], contacts.distance_m, np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a slot in which nobody speaks to Earth
        relay_distance_m = np.nanmin(speakers, axis=2)
    return {
        "edges_s": contacts.edges_s,
        "light_time_s": contacts.light_time_s,
        "contact_bit": contacts.swarm_bit,
        "earth_contact_bit": contacts.earth_bit,
        "station": contacts.station,
        "why_swarm": contacts.why_swarm,
        "why_earth": contacts.why_earth,
        "relay_distance_m": relay_distance_m,
    }


def _held(tiles: Tiles) -> dict[str, Any]:
    return {
        "tile_of_cell": tiles.of_cell,
        "tile_area": tiles.area,
        "tile_bit": tiles.bits,
        "tile_ready_s": np.where(np.isfinite(tiles.ready_s), tiles.ready_s, np.nan),
    }


def _delivered(network: Network, account: Account, light_time_s: Array) -> dict[str, Any]:
    shape = (network.n_slots, network.n_spacecraft)
    sent, earth = np.zeros((*shape, network.n_spacecraft), np.int64), np.zeros(shape, np.int64)
    lost = np.zeros((network.n_slots + 1, network.n_spacecraft), np.int64)
    by_reason = {reason: np.zeros_like(network.bits) for reason in (SPACECRAFT_LOST, STORAGE_FULL, ON_EARTH)}
    for transfer in account.transfers:
        if transfer.receiver == EARTH:
            earth[transfer.slot, transfer.sender] += transfer.bits
        else:
            sent[transfer.slot, transfer.sender, transfer.receiver] += transfer.bits
    for loss in account.losses:
        lost[loss.slot, loss.spacecraft] += loss.bits
        by_reason[loss.reason][loss.origin, loss.tile] += loss.bits
    arrives_s = np.append(network.edges_s[1:] + light_time_s, np.nan)
    return {
        "sent_bit": sent,
        "earth_bit": earth,
        "aboard_bit": account.aboard_bit,
        "lost_bit": lost.cumsum(axis=0),
        "tile_lost_bit": by_reason[SPACECRAFT_LOST],
        "tile_overflow_bit": by_reason[STORAGE_FULL],
        "tile_arrives_s": arrives_s[account.delivered_slot],
        "tile_origin": account.delivered_origin,
    }


def tiles_of(plan: Plan, telemetry: xr.Dataset, kept: KeptPictures) -> Tiles:
    """The data of a flight: of each picture the part that is sent, shared out over the cells that are kept by it."""
    region, environment = plan.region, plan.environment
    limits = limits_of(plan.scenario.observation, camera_from(plan.scenario), region)
    times, ready_s = telemetry["time"].values, np.full(kept.taken_s.shape, np.nan)
    bits, (C_CN, _) = np.zeros(ready_s.shape), flown_cameras(plan.scenario, telemetry)
    for t, j, cells in kept.pictures():
        k, C_AN = int(np.searchsorted(times, t)), environment.C_AN(t)
        pose = CameraPose(C_AN @ telemetry["r_BN_N"].values[k, j], C_CN[k, j] @ C_AN.T)
        pixels = pixels_on(limits, region.area[cells], *sight(region, pose.r_A, cells))
        bits[j, cells] += pixels * (sent_bit(plan.scenario, region, pose, cells, pixels) / pixels.sum())
        ready_s[j, cells] = t
    return make_tiles(region.weighted_area, ready_s, bits, kept.gsd_m)


def sent_bit(scenario: Scenario, region: TargetRegion, pose: CameraPose, cells: Ints, pixels: Array) -> float:
    """Data that are sent of a picture for some cells in it [bit], see `data.product`.

    Args:
        scenario: Says what is sent.
        region: The target.
        pose: Of the camera.
        cells: Their numbers.
        pixels: That they take up.
    """
    per_pixel, product = scenario.data.sent_bits_per_pixel, scenario.data.product
    if product == "cells":
        return per_pixel * float(pixels.sum())
    frame_bit = per_pixel * frame_pixels(scenario)
    if product == "frame":
        return frame_bit
    x, y, z = pose.to_camera(region.corners_A[cells].reshape(-1, 3)).T
    camera = camera_from(scenario)
    if (z <= 0.0).any():
        return frame_bit
    edges = (z * camera.tan_half_angle * most for most in camera.sides)
    across, down = (np.ptp(np.clip(side / edge, -1.0, 1.0)) for side, edge in zip((x, y), edges, strict=True))
    return max(frame_bit * 0.25 * float(across * down), per_pixel)


def frame_pixels(scenario: Scenario) -> int:
    """Pixels of a whole picture of the real detector: as many as its pixel's angle makes, where nothing else is said."""
    camera = camera_from(scenario)
    side = round(2.0 * camera.tan_half_angle / camera.pixel_angle)
    width, height = scenario.data.sensor_px or scenario.camera.detector_px or (side, side)
    return width * height


def slot_edges(scenario: Scenario, ready_s: Array, most: int) -> Array:
    """Edges of the slots [s] from the first qualifying image to the end of the horizon.

    Args:
        scenario: Says how long slots are, and how long data are sent.
        ready_s: When pictures were taken, infinity for never.
        most: Slots, about; fewer than the scenario asks for make them longer.
    """
    data, taken = scenario.data, ready_s[np.isfinite(ready_s)]
    first, last = (float(taken.min()), float(taken.max())) if len(taken) else (scenario.duration_s,) * 2
    most = max(most, 4)
    slot_s = max(data.slot_s, (last - first) / min(MAX_IMAGING_SLOTS, most / 2))
    end = max(scenario.duration_s + data.horizon_s, first + slot_s)
    edges = list(first + slot_s * np.arange(int(np.ceil((last - first) / slot_s)) + 1))
    slot_s = max(slot_s, 2.0 * (end - last) / most)
    longest_s = max(slot_s, LONGEST_SLOT_S)
    while edges[-1] < end - 1e-6:
        slot_s = min(GROWTH * slot_s, longest_s)
        edges.append(min(edges[-1] + slot_s, end))
    return np.array(edges)


@dataclass(frozen=True, eq=False)
class SampledSwarm:
    """The swarm at the samples of the slots, but for who speaks to Earth after the flight."""

    plan: Plan  #: what was flown
    telemetry: xr.Dataset  #: the flight
    edges_s: Array  #: edges of the slots [s], shape (T + 1,)
    flown: Instants  #: at those samples that are in the flight
    course: Course  #: at those after it

    @classmethod
    def of_flight(cls, plan: Plan, telemetry: xr.Dataset, edges_s: Array) -> SampledSwarm:
        """Sample a flight, and go on after it."""
        times = samples_of(edges_s, samples_per_slot(plan.scenario)).ravel()
        later = times > float(telemetry["time"].values[-1])
        flown = flown_instants(plan, telemetry, times[~later])
        return cls(plan, telemetry, edges_s, flown, post_flight_paths(plan, telemetry, times[later]))

    def instants(self, relays: Ints) -> Instants:
        """With those who speak to Earth at each time after the flight, numbers from 0, shape (m, k)."""
        if not len(self.course.t):
            return self.flown
        last_BN = dcm(self.telemetry["sigma_BN"].values[-1])
        return joined(self.flown, post_flight_instants(self.plan, last_BN, self.course, relays))

    def contacts(self, instants: Instants) -> Contacts:
        """What geometry, radios, attitude control and the swarm's class allow besides the messages of coordination."""
        found = crosslinks_left(contacts_of(self.plan, self.edges_s, instants), self.telemetry, self.plan.scenario)
        directed = self.plan.scenario.link.crosslink.antenna != "omnidirectional"
        return less_pointing(found, self.telemetry, directed=directed)


class Problem(NamedTuple):
    """A delivery problem, and who turns to Earth in each slot, shape (T, n)."""

    network: Network
    speaks: Mask


class Trials:
    """What of a swarm's tiles could be delivered if others spoke to Earth after the flight; the paths stay the same."""

    def __init__(self, swarm: SampledSwarm, tiles: Tiles) -> None:
        self._swarm, self._tiles = swarm, tiles
        self._last: tuple[tuple[int, ...], Problem] | None = None

    def value(self, relays: tuple[int, ...]) -> float:
        """What the best schedule delivers with them as the only relays [m^2]; the swarm alone where that takes `PROOF_S`."""
        network, speaks = self.problem(relays)
        alone = run_online(network, speaks).value
        if alone >= reachable_value(network) * (1.0 - SAME):
            return alone  # nothing is left to be proven
        try:
            return optimum(network, neighbours=_neighbours(network), time_limit_s=PROOF_S).value
        except MissionError:
            return alone

    def bound(self, relays: tuple[int, ...]) -> float:
        """What finds a way to Earth at all [m^2]."""
        return reachable_value(self.problem(relays).network)

    def problem(self, relays: tuple[int, ...]) -> Problem:
        """The delivery problem with them."""
        if self._last is None or self._last[0] != relays:
            self._last = relays, self._with(relays)
        return self._last[1]

    def _with(self, relays: tuple[int, ...]) -> Problem:
        if self._swarm.plan.scenario.link.crosslink.antenna != "omnidirectional":
            return self._anew(relays)
        # The crosslinks are the same whoever speaks to Earth, and nobody's way to Earth asks for the others' roles.
        (every, all_speak), (nobody, in_flight) = self._all, self._none
        elected = np.isin(np.arange(self._swarm.plan.n), relays)
        network = replace(every, earth_bit=np.where(elected, every.earth_bit, nobody.earth_bit))
        return Problem(network, np.where(elected, all_speak, in_flight))

    def _anew(self, relays: Sequence[int]) -> Problem:
        swarm = self._swarm
        instants = swarm.instants(np.tile(np.array(relays, np.int64), (len(swarm.course.t), 1)))
        contacts = swarm.contacts(instants)
        network = network_of(swarm.plan.scenario, self._tiles, contacts, instants)
        return Problem(network, speaking(instants, network.n_slots))

    @cached_property
    def _all(self) -> Problem:
        return self._anew(range(self._swarm.plan.n))

    @cached_property
    def _none(self) -> Problem:
        return self._anew(())


def samples_per_slot(scenario: Scenario) -> int:
    """How often contacts are looked at in a slot."""
    return int(np.clip(np.ceil(scenario.data.slot_s / SAMPLE_S), FEWEST_SAMPLES, MOST_SAMPLES))


def speaking(instants: Instants, n_slots: int) -> Mask:
    """Who turns to Earth in the middle of each slot, shape (T, n)."""
    modes = instants.mode.reshape(n_slots, -1, instants.mode.shape[1])
    turned: Mask = modes[:, modes.shape[1] // 2] == TargetKind.EARTH
    return turned


def contacts_of(plan: Plan, edges_s: Array, instants: Instants) -> Contacts:
    """What geometry and the scenario's radios allow."""
    link = plan.scenario.link
    heard = earth_schedule(link.ground, plan.scenario.epoch, instants.t, instants.r_BN_N.mean(axis=1), instants.earth_N)
    radios = radios_from(link, plan.antennas)
    beside = None
    if (companion := plan.environment.companion) is not None:
        beside = occluder_of(companion.shape), _seen_from(companion, instants)
    return find_contacts(edges_s, instants, radios=radios, body=occluder_of(plan.shape), heard=heard, beside=beside)


def _seen_from(companion: Companion, instants: Instants) -> Instants:
    """The same with positions relative to the companion's centre, and its rotation."""
    places = np.array([companion.position(t) for t in instants.t])
    return replace(
        instants,
        r_BN_N=instants.r_BN_N - places[:, None],
        C_AN=np.array([companion.C_AN(t) for t in instants.t]),
        earth_N=instants.earth_N - places,
    )


def network_of(
    scenario: Scenario, tiles: Tiles, contacts: Contacts, instants: Instants, *, continuous: bool = False
) -> Network:
    """The delivery problem of some data and contacts.

    Args:
        scenario: Says what radios and storage are.
        tiles: What is to be sent.
        contacts: How much each slot carries.
        instants: The swarm at the samples of the slots.
        continuous: Relax it to a bound on all schedules in continuous time: each link is as good all the slot long as at its
            best sample; who works at one sample works till the slot's end; pictures are there from its start; what is
            received can be sent on at once. Rates between the samples are assumed not to exceed those at them.
    """
    n = len(tiles.bits)
    samples = instants.works.reshape(contacts.n_slots, -1, n)
    works = samples.any(axis=1) if continuous else samples.all(axis=1)
    if continuous:
        swarm_bit, earth_bit = contacts.peak_bit[:, :, :n], contacts.peak_bit[:, :, n]
        ready = np.minimum(np.searchsorted(contacts.edges_s, tiles.ready_s + 1e-6, side="right") - 1, contacts.n_slots)
    else:
        swarm_bit, earth_bit = contacts.swarm_bit, contacts.earth_bit
        ready = np.searchsorted(contacts.edges_s[:-1], tiles.ready_s - 1e-6)
    return Network(
        edges_s=contacts.edges_s,
        swarm_bit=swarm_bit,
        earth_bit=earth_bit,
        storage_bit=np.full(n, scenario.data.storage_bit, np.int64),
        access=Access(scenario.link.crosslink.access),
        half_duplex=radio_from(scenario.link.crosslink, "link.crosslink").duplex == "half",
        earth_channels=scenario.link.ground.channels,
        value=tiles.area,
        bits=tiles.bits,
        gsd_m=tiles.gsd_m,
        ready=ready.astype(np.int64),
        lost_slot=np.where(works.all(axis=0), contacts.n_slots, np.argmin(works, axis=0)),
        delay=0 if continuous else 1,
    )
