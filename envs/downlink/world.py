"""What episodes of SwarmDownlink-v0 draw from: paths after an arrival, contacts by `swarm_mj.dataflow`, sunlight, products."""

from __future__ import annotations

from dataclasses import asdict
from typing import NamedTuple

import numpy as np

from swarm_mj.dataflow.contacts import Contacts, Instants, find_contacts, radios_from, samples_of
from swarm_mj.dataflow.ground import earth_schedule
from swarm_mj.dataflow.network import Access
from swarm_mj.dataflow.radios import radio_from
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import Plan, antennas_from, make_plan
from swarm_mj.flight.post_flight import turned
from swarm_mj.flight.refusals import refuse_turned_cameras_and_companions
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.trajectories import propagate
from swarm_mj.scenarios.constants import AU, DAY
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.smallbody.occultation import occluder_of, segments_blocked
from swarm_mj.typing import Array, Ints, Mask

from ..arguments import refuse_extra_targets
from ..snapshots import digest
from .config import DownlinkConfig, Draw

#: Instants of a slot at which contacts and sunlight are looked at.
PER_SLOT = 2
#: Relative tolerance of the paths: 1 m in 10,000 km, which no link notices.
RTOL = 1e-7


class DownlinkConditions(NamedTuple):
    """What surrounds one episode of T slots, n spacecraft and up to K products; failures are in it.

    Attributes:
        capacity_bit: Most that i can send to j in a slot, in the last column to Earth [bit], shape (T, n, n + 1).
        sun_J: What panels that face the Sun bring in a slot, shape (T, n).
        earth_J: What they bring while the dish points at Earth, shape (T, n).
        allotted: Whether a pass is allotted to the swarm and a station sees it in any part of the slot, shape (T,).
        lost_slot: From whose start a spacecraft is lost, T for never, shape (n,).
        charge_J: At the beginning, shape (n,).
        origin: Spacecraft that has the product, shape (K,).
        size: [bit], 0 where there is no product, shape (K,).
        value: Their sum is 1, shape (K,).
        ready: Slot from whose start it is aboard, T for never, shape (K,).
        expiry: Slot from whose start it is worth nothing, at most T, shape (K,).
        order: Products by value of a bit, most valuable first, shape (K,).
    """

    capacity_bit: Ints
    sun_J: Array
    earth_J: Array
    allotted: Mask
    lost_slot: Ints
    charge_J: Array
    origin: Ints
    size: Ints
    value: Array
    ready: Ints
    expiry: Ints
    order: Ints


class Paths(NamedTuple):
    """Where the swarm is in an episode: at the samples of its slots, two in each.

    Attributes:
        t: Past the scenario's epoch [s], shape (m,).
        r_BN_N: Positions [m], shape (m, n, 3).
        earth_N: Position of Earth [m], shape (m, 3).
    """

    t: Array
    r_BN_N: Array
    earth_N: Array


class DownlinkTask:
    """One mission after its arrival, by the environment's arguments; made once, never changed.

    Attributes:
        given: The scenario, overrides applied.
        plan: The mission.
        n: Spacecraft.
        access: How they share the crosslink.
        half_duplex: Whether a spacecraft on it sends or hears, but never both at once.
        best_earth_bit: Most that Earth hears of one spacecraft in a slot at the arrival's distance [bit].
        best_swarm_bit: Most that a crosslink carries in a slot [bit].
        full_sun_J: What panels that face the Sun bring in a slot at the arrival's distance.

    Raises:
        ScenarioError: An argument does not fit the scenario.
    """

    def __init__(self, config: DownlinkConfig) -> None:
        given = load_scenario(config.scenario, config.overrides)
        refuse_extra_targets(given)
        if given.link.crosslink.antenna != "omnidirectional":
            raise ScenarioError(
                f"link.crosslink.antenna = {given.link.crosslink.antenna!r}: must be omnidirectional, since SwarmDownlink-v0 "
                "does not turn spacecraft to each other"
            )
        self.config, self.given = config, given
        refuse_turned_cameras_and_companions(given, "SwarmDownlink-v0")
        self.plan: Plan = make_plan(given)
        self.n = self.plan.n
        self.access = Access(given.link.crosslink.access)
        self.half_duplex = radio_from(given.link.crosslink, "link.crosslink").duplex == "half"
        self._radios = radios_from(given.link, antennas_from(given))
        self._body, self._draw, self._power = occluder_of(self.plan.shape), config.draws, config.powers
        self._arrival_s = float(self.plan.deployment.arrival_s.max())
        self._paths = self._plan_paths()
        self.best_swarm_bit = float(self._radios.swarm.rate_bit_s[0]) * config.step_s
        self.best_earth_bit = self._best_earth_rate() * config.step_s
        self.full_sun_J = float(self._full_sun_J(np.array([self._arrival_s]))[0])

    @property
    def fingerprint(self) -> str:
        """Digest of all that must agree where the state of an episode is taken up."""
        config = self.config
        numbers = (config.step_s, config.horizon_s, config.products, config.storage_bit)
        drawn = (asdict(config.powers), asdict(config.draws), config.weights)
        return digest("downlink", self.given.model_dump(mode="json"), *numbers, *drawn)

    def draw(self, rng: np.random.Generator) -> DownlinkConditions:
        """The conditions of an episode."""
        config, draw = self.config, self._draw
        paths, turn_s = self.draw_paths(rng), rng.uniform(0.0, DAY)
        allotted = _passes(draw, config.slots * PER_SLOT, config.step_s / PER_SLOT, rng)
        contacts, station = self.contacts(paths, allotted, turn_s)
        sun_J, earth_J = self.sunlight(paths)
        products = _products(config, draw, self.n, rng)
        charge_J = self._power.battery_J * rng.uniform(min(draw.charge, 1.0), 1.0, self.n)
        capacity_bit = np.concatenate([contacts.swarm_bit, contacts.earth_bit[:, :, None]], axis=2)
        lost_slot = self._fail(capacity_bit, (sun_J, earth_J), rng)
        seen = np.any((station >= 0).reshape(config.slots, PER_SLOT), axis=1)
        return DownlinkConditions(capacity_bit, sun_J, earth_J, seen, lost_slot, charge_J, *products)

    def draw_paths(self, rng: np.random.Generator) -> Paths:
        """The plan's paths from a drawn time after the arrival on, each spacecraft drifting off by a drawn velocity."""
        config, draw = self.config, self._draw
        first = int(rng.integers(int(draw.start_s / config.step_s) + 1)) * PER_SLOT
        drift = rng.normal(0.0, 1.0, (self.n, 3)) * draw.drift_m_s
        part = slice(first, first + config.slots * PER_SLOT)
        t, r_N, earth_N = (array[part] for array in self._paths)
        return Paths(t, r_N + drift * (t - self._arrival_s)[:, None, None], earth_N)

    def contacts(self, paths: Paths, allotted: Mask, turn_s: float = 0.0) -> tuple[Contacts, Ints]:
        """What `dataflow` says the links carry, every spacecraft with its dish at Earth, and the station at each sample.

        Args:
            paths: Where the swarm is.
            allotted: Whether a pass is allotted at each sample, shape (m,).
            turn_s: By which Earth has turned on [s].
        """
        plan, (t, r_N, earth_N) = self.plan, paths
        heard = earth_schedule(
            plan.scenario.link.ground, plan.scenario.epoch, t, r_N.mean(axis=1), earth_N, turn_s=turn_s
        )
        heard = heard._replace(station=np.where(allotted, heard.station, -1))
        instants = Instants(
            t=t,
            r_BN_N=r_N,
            C_BN=turned(np.tile(np.eye(3), (self.n, 1, 1)), earth_N[:, None] - r_N),
            C_AN=np.array([plan.environment.C_AN(s) for s in t]),
            earth_N=earth_N,
            mode=np.full(r_N.shape[:2], int(TargetKind.EARTH), np.int64),
            tracked=np.full(r_N.shape[:2], -1, np.int64),
            works=np.ones(r_N.shape[:2], np.bool_),
        )
        edges = self.config.step_s * np.arange(self.config.slots + 1.0)
        return find_contacts(edges, instants, radios=self._radios, body=self._body, heard=heard), heard.station

    def sunlight(self, paths: Paths) -> tuple[Array, Array]:
        """What panels bring in each slot that face the Sun, and that are turned about a dish that points at Earth.

        Their normals lie across the dish's axis, so that the best turn about it leaves the sine of the angle from Earth to the
        Sun. The body casts the shadow of a point source.

        Returns:
            Each of shape (T, n) [J].
        """
        t, r_N, earth_N = paths
        environment, m = self.plan.environment, len(t)
        to_sun = np.array([environment.sun.at(s) for s in t])[:, None] - r_N
        to_earth = earth_N[:, None] - r_N
        sun, earth = (way / np.linalg.norm(way, axis=-1, keepdims=True) for way in (to_sun, to_earth))
        # Beyond a few radii the body can hide nothing more.
        reach = 4.0 * self._body.max_radius + 2.0 * np.linalg.norm(r_N, axis=-1, keepdims=True)
        C_AN = np.array([environment.C_AN(s) for s in t])
        start, end = (np.einsum("mab,mnb->mna", C_AN, r).reshape(-1, 3) for r in (r_N, r_N + reach * sun))
        body = self._body
        dark = segments_blocked(start, end, body.vertices, body.faces, body.max_radius).reshape(m, self.n)
        full = self._full_sun_J(t)[:, None] * ~dark
        across = np.linalg.norm(np.cross(sun, earth), axis=-1)
        slots = (self.config.slots, PER_SLOT, self.n)
        return full.reshape(slots).mean(axis=1), (full * across).reshape(slots).mean(axis=1)

    def _full_sun_J(self, t: Array) -> Array:
        au = np.array([np.linalg.norm(self.plan.environment.sun.at(s)) for s in t]) / AU
        return self._power.panel_1au_W * self.config.step_s / au**2

    def _plan_paths(self) -> Paths:
        plan, config = self.plan, self.config
        slots = config.slots + int(self._draw.start_s / config.step_s)
        t = self._arrival_s + samples_of(config.step_s * np.arange(slots + 1.0), PER_SLOT).ravel()
        leaves = float(plan.deployment.release_s.max())
        r0_N, v0_N = plan.deployment.release_r_N, plan.deployment.v0_N
        r_N = propagate(plan.environment.acceleration_N, r0_N, v0_N, np.concatenate(([leaves], t)), rtol=RTOL)[0][1:]
        return Paths(t, r_N, np.array([plan.environment.earth.at(s) for s in t]))

    def _best_earth_rate(self) -> float:
        distance = np.linalg.norm(self._paths.earth_N[0])
        rates = [rate[distance <= range_m] for range_m, rate in zip(*self._radios.earth, strict=True)]
        best = max((float(fits[0]) for fits in rates if len(fits)), default=0.0)
        if not best > 0.0:
            raise ScenarioError(
                "link.earth: no station of link.ground hears it over the distance of the arrival; allowed are radios that some "
                "station hears; raise link.earth.power_w or gain_dbi"
            )
        return best

    def _fail(self, capacity_bit: Ints, energy: tuple[Array, Array], rng: np.random.Generator) -> Ints:
        """Draw failures and put them into the tables; returns from which slot on each spacecraft is lost."""
        draw, slots = self._draw, self.config.slots
        fails = rng.random((3, self.n)) < np.array([draw.radio_fails, draw.panel_fails, draw.lost])[:, None]
        when = np.where(fails, rng.integers(1, slots + 1, (3, self.n)), slots)
        for i, (radio, panel, lost) in enumerate(when.T):
            capacity_bit[min(radio, lost) :, i, self.n] = 0
            capacity_bit[lost:, i], capacity_bit[lost:, :, i] = 0, 0
            for brings_J in energy:
                brings_J[panel:, i] *= 0.5
                brings_J[lost:, i] = 0.0
        return np.asarray(when[2], np.int64)


def _passes(draw: Draw, samples: int, sample_s: float, rng: np.random.Generator) -> Mask:
    """Whether a ground antenna is allotted at each sample: passes and gaps in turn, from a drawn place in the first pair."""
    allotted = np.zeros(samples, np.bool_)
    end = -rng.uniform(0.0, draw.pass_most_s + draw.gap_most_s)
    while end < samples * sample_s:
        start = end + rng.uniform(0.0, draw.gap_most_s)
        end = start + rng.uniform(draw.pass_s, draw.pass_most_s)
        allotted[max(0, round(start / sample_s)) : max(0, round(end / sample_s))] = True
    return allotted


def _products(
    config: DownlinkConfig, draw: Draw, n: int, rng: np.random.Generator
) -> tuple[Ints, Ints, Array, Ints, Ints, Ints]:
    """Origin, size, value, ready, expiry and order of the products; as many draws however many there are."""
    most, slots = config.products, config.slots
    there = np.arange(most) < rng.integers(int(draw.products), most + 1)
    origin = rng.choice(n, most, p=rng.dirichlet(np.full(n, draw.unequal)))
    size = np.exp(rng.uniform(np.log(draw.size_bit), np.log(draw.size_most_bit), most))
    density = np.exp(rng.uniform(0.0, np.log(max(draw.density, 1.0)), most))
    later = rng.random(most) < draw.later
    ready = np.where(later, rng.integers(0, max(1, 2 * slots // 3), most), 0)
    life = np.maximum(1, np.rint(slots * rng.uniform(draw.lifetime, draw.lifetime_most, most))).astype(np.int64)
    bits = np.where(there, np.ceil(size), 0.0).astype(np.int64)
    value = np.where(there, density * bits, 0.0)
    first = np.lexsort((np.arange(most), np.where(there, -density, 0.0)))
    return (
        origin.astype(np.int64),
        bits,
        value / value.sum(),
        np.where(there, ready, slots).astype(np.int64),
        np.where(there, np.minimum(ready + life, slots), slots).astype(np.int64),
        first.astype(np.int64),
    )
