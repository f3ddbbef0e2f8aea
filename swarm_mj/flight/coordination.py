"""The class of a swarm in flight: its behaviour, made from the plan, and what its messages cost."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from swarm_mj.coordination.allocation.problem import Schedule
from swarm_mj.coordination.bus import MessageLog
from swarm_mj.coordination.coordinated_behavior import PARTS, CoordinatedBehavior, CoordinationPlan, PicturePlan
from swarm_mj.coordination.graph import Graph, graph_at
from swarm_mj.dataflow.contacts import Contacts, Instant, radios_from
from swarm_mj.dataflow.network import Access
from swarm_mj.errors import MissionError
from swarm_mj.flight.encounter_table import alone, encounter_of, together, track_of
from swarm_mj.flight.observe import observer_from
from swarm_mj.flight.refusals import refuse_turned_cameras_and_companions
from swarm_mj.mission.behaviors import Behavior, SelectiveBehavior, SwarmView, TargetKind, Targets
from swarm_mj.mission.links import Obstacle
from swarm_mj.observation.camera import Motion
from swarm_mj.observation.capture import camera_poses, observe
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_swarm import Swarm
from swarm_mj.simulator.telemetry import VARIABLES
from swarm_mj.smallbody.occultation import occluder_of
from swarm_mj.spacecraft.attitude.mrp import dcm, mrp_from_quaternion
from swarm_mj.typing import Array, Ints, Mask

#: Variables of the telemetry.
BITS, AIRTIME = "coordination_bits", "coordination_airtime"
#: Of the messages by which a formation is held.
FORMATION_AIRTIME = "formation_airtime"


def coordinated(behavior: Behavior, scenario: Scenario) -> Behavior:
    """The behaviour of a scenario's class; its own where that decides alone.

    Raises:
        MissionError: The class's parts do not fit together, or an election is asked for that nobody can hold.
    """
    if (swarm := scenario.swarm) is None:
        return behavior
    refuse_turned_cameras_and_companions(scenario, "a swarm that coordinates in flight (swarm)")
    parts, election = parts_chosen(swarm), scenario.data.election
    if acts_alone(swarm) and election != "flight":
        why = (
            "swarm.message_loss = 1" if swarm.message_loss == 1.0 else f"swarm.class = {swarm.level}, swarm.relay = own"
        )
        raise MissionError(
            f"data.election = {election}: takes messages, which {why} rules out; must be 'flight', with which nobody is elected"
        )
    if parts == PARTS[2]:
        return behavior
    if "behavior" in parts.values():
        raise MissionError(
            f"swarm.sensing = {parts['sensing']}, swarm.relay = {parts['relay']}: the behaviour decides both or none; give "
            "behavior twice, or own, plan, auction or election"
        )
    return CoordinatedMissionBehavior(behavior, swarm)


def parts_chosen(swarm: Swarm) -> dict[str, str]:
    """The parts of a class, with those that the scenario exchanges."""
    return {key: getattr(swarm, key) or part for key, part in PARTS[swarm.level].items()}


@dataclass(frozen=True)
class CoordinatedMissionBehavior:
    """A swarm of class 0, 1, 3 or 4, before it knows its mission; see `MissionBehavior`.

    Attributes:
        inner: The scenario's behaviour, which says whether a spacecraft flies that only communicates.
        swarm: The class and its parts.
    """

    inner: Behavior
    swarm: Swarm

    @property
    def dedicated_communications(self) -> bool:
        """See `Behavior`."""
        return self.inner.dedicated_communications

    def check_scenario(self, scenario: Any) -> None:
        """See `SelectiveBehavior`: what the scenario's behaviour cannot fly, its swarm does not either."""
        if isinstance(self.inner, SelectiveBehavior):
            self.inner.check_scenario(scenario)

    def for_flight(self, plan: Any) -> Behavior:
        """See `MissionBehavior`."""
        return CoordinatedBehavior(coordination_plan(plan, self.swarm))

    def targets(self, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
        """Not before `for_flight`.

        Raises:
            MissionError: Always.
        """
        raise MissionError("swarm.class: a coordinated swarm must know its mission; use for_flight(plan) first")


def coordination_plan(
    plan: Any,
    swarm: Swarm,
    parts: dict[str, str] | None = None,
    planned: PicturePlan | None = None,
    succession: Ints | None = None,
) -> CoordinationPlan:
    """What the swarm of a `swarm_mj.flight.plan.Plan` is given before its release.

    Args:
        plan: What is flown.
        swarm: How it coordinates.
        parts: Of the swarm; None: those of its class.
        planned: Its pictures; None: planned as its parts ask for.
        succession: See `CoordinationPlan`; None: by its pictures.
    """
    scenario, parts = plan.scenario, parts or parts_chosen(swarm)
    encounter = encounter_of(plan) if planned is None else planned.encounter
    pictures: tuple[Schedule, ...] = ((),) * plan.n_observers
    if planned is None and (parts["sensing"] == "plan" or parts["relay"] == "plan"):
        planned = PicturePlan(encounter, together(encounter, swarm.plan_time_limit_s))
    if parts["sensing"] == "own":
        pictures = alone(encounter)
    elif planned is not None:
        pictures = planned.allocation.pictures
    observer, criterion = observer_from(scenario, plan.region), scenario.observation

    def cells_shown(view: SwarmView, j: int) -> Mask:
        assert view.q_BN is not None
        C_BN = dcm(mrp_from_quaternion(view.q_BN[j : j + 1]))
        r_A, C_CA = camera_poses(view.r_BN_N[j : j + 1], C_BN, view.C_AN)
        motion = None
        if view.omega_BN_B is not None:
            moving = Motion(view.v_BN_N, view.omega_BN_B, plan.environment.spin_N)
            motion = moving.of(j, view.r_BN_N[j], C_BN[0], view.C_AN)
        sun_A = view.C_AN @ plan.environment.sun.at(view.t)
        return observe(observer, r_A[0], C_CA[0], criterion, sun_A, motion)

    return CoordinationPlan(
        encounter=encounter,
        pictures=pictures,
        **parts,
        planned=planned if parts["sensing"] == "plan" else None,
        succession=succession_of(plan, pictures, encounter.slot_s[-1]) if succession is None else succession,
        cells_shown=cells_shown,
        graph=links_of(plan, swarm),
        silence_s=swarm.silence_s,
        seed=scenario.seed,
        access=Access(scenario.link.crosslink.access),
        dedicated_communications=plan.behavior.dedicated_communications,
    )


def succession_of(plan: Any, pictures: tuple[Schedule, ...], end_s: float) -> Ints:
    """Places in the order in which spacecraft relay, shape (n,): who has done with its pictures first, then the most central.

    A spacecraft that only communicates comes first.
    """
    r_A = track_of(plan, np.array([end_s])).r_A[0]
    spread = np.linalg.norm(r_A[:, None] - r_A[None], axis=2).sum(axis=1)
    last = np.array([taken[-1][0] if taken else -1 for taken in pictures], np.int64)
    extra = plan.n - len(r_A)
    order = np.lexsort((np.append(spread, np.zeros(extra)), np.append(last, np.full(extra, -2))))
    place: Ints = np.empty(plan.n, np.int64)
    place[order] = np.arange(plan.n)
    return place


def links_of(plan: Any, swarm: Swarm) -> Callable[[SwarmView, Targets], Graph]:
    """A function that says, by a view and what all track, which links close at that instant."""
    scenario, n = plan.scenario, plan.n
    radios, body = radios_from(scenario.link, plan.antennas), occluder_of(plan.shape)

    def graph(view: SwarmView, targets: Targets) -> Graph:
        C_BN = np.tile(np.eye(3), (n, 1, 1)) if view.q_BN is None else dcm(mrp_from_quaternion(view.q_BN))
        works = np.ones(n, np.bool_) if view.working is None else np.array(view.working)
        earth_N = plan.environment.earth.at(view.t)
        r_N, C_AN = np.ascontiguousarray(view.r_BN_N), np.ascontiguousarray(view.C_AN)
        now = Instant(r_N, C_BN, C_AN, earth_N, targets.kind, targets.spacecraft, works)
        return graph_at(radios, body, now, loss=swarm.message_loss, processing_s=swarm.processing_s)

    return graph


def record_coordination(telemetry: xr.Dataset, behavior: Any) -> None:
    """Add what plan and messages of a coordinated swarm came to; nothing where the behaviour is another or has neither."""
    if not isinstance(behavior, CoordinatedBehavior):
        return
    if behavior.mission.planned is not None:
        telemetry.attrs["picture_plan"] = json.dumps(picture_plan_summary(behavior))
    if not behavior.mission.talks:
        return
    add_messages(telemetry, behavior.log, BITS, AIRTIME)
    names = telemetry["spacecraft"].values
    events = [{**event._asdict(), "spacecraft": str(names[event.spacecraft])} for event in behavior.log.events]
    telemetry.attrs["coordination_events"] = json.dumps(events)


def add_messages(telemetry: xr.Dataset, log: MessageLog, *names: str) -> None:
    """Add bits and airtime of messages to the telemetry, under their names."""
    sent = log.sent_by(telemetry["time"].values, telemetry.sizes["spacecraft"])
    for name, values in zip(names, sent, strict=True):
        telemetry[name] = VARIABLES[name].of(values)


def picture_plan_summary(behavior: CoordinatedBehavior) -> dict[str, Any]:
    """A plan of pictures beside its bound, in shares of the target, and what its pictures showed in flight."""
    encounter, log = behavior.mission.encounter, behavior.log
    assert behavior.mission.planned is not None
    planned, percent = behavior.mission.planned.allocation, 100.0 / float(encounter.area.sum())
    found = {
        "objective": behavior.mission.planned.objective,
        "planned_percent": round(percent * planned.value, 6),
        "bound_percent": round(percent * planned.bound, 6),
        "gap_percent": round(100.0 * (1.0 - planned.value / planned.bound), 6) if planned.bound else 0.0,
        "proven": planned.proven,
        "pictures": sum(map(len, planned.pictures)),
        "aims": len(encounter.aims_A),
        "aim_spacing": round(encounter.spacing, 3),
    }
    if not behavior.mission.planned.repaired:
        return found
    return found | {"taken": log.taken, "as_planned": log.as_planned, "plans_repaired": log.repaired}


def coordination_summary(telemetry: xr.Dataset) -> dict[str, Any]:
    """Keys of the summary; empty for flights without plan and messages."""
    planned = {"picture_plan": json.loads(telemetry.attrs["picture_plan"])} if "picture_plan" in telemetry.attrs else {}
    if BITS not in telemetry:
        return planned
    return planned | {
        "coordination_bits": int(telemetry[BITS].values[-1].sum()),
        "coordination_airtime_s": float(telemetry[AIRTIME].values[-1].sum()),
        "coordination_events": json.loads(telemetry.attrs["coordination_events"]),
    }


def crosslinks_left(contacts: Contacts, telemetry: xr.Dataset, scenario: Scenario) -> Contacts:
    """What the crosslinks can carry of the pictures: in each slot what the swarm's own messages leave of its time.

    Nothing where every spacecraft sends to Earth itself. What is lost is sent again until it is there (selective repeat), which
    leaves 1 - `swarm.message_loss` of a link's rate (Bertsekas and Gallager 1992, Data Networks, section 2.4).

    Args:
        contacts: Without messages.
        telemetry: Of the flight.
        scenario: Says who relays, what is lost, and how the channel is shared: by all, or by each sender.
    """
    swarm = scenario.swarm
    if swarm is not None and parts_chosen(swarm)["relay"] == "own":
        nothing, roles = np.zeros_like(contacts.swarm_bit), np.full_like(contacts.why_swarm, Obstacle.ROLE)
        return replace(contacts, swarm_bit=nothing, why_swarm=roles, peak_bit=_thinned(contacts.peak_bit, 0.0))
    arrives = 1.0 - (swarm.message_loss if swarm is not None else 0.0)
    left = arrives * (1.0 - _share_of_messages(contacts, telemetry, Access(scenario.link.crosslink.access)))
    swarm_bit = np.floor(contacts.swarm_bit * left[:, :, None]).astype(np.int64)
    return replace(contacts, swarm_bit=swarm_bit, peak_bit=_thinned(contacts.peak_bit, arrives))


def _thinned(peak_bit: Ints, arrives: float) -> Ints:
    """`Contacts.peak_bit` of links over which a part arrives; the ways to Earth, in the last column, are as before."""
    return np.concatenate((np.ceil(arrives * peak_bit[:, :, :-1]).astype(np.int64), peak_bit[:, :, -1:]), axis=2)


def _share_of_messages(contacts: Contacts, telemetry: xr.Dataset, access: Access) -> Array:
    """Part of each slot that the swarm's own messages take from what each could send, shape (T, n)."""
    n = contacts.swarm_bit.shape[1]
    messages = [telemetry[name].values for name in (AIRTIME, FORMATION_AIRTIME) if name in telemetry]
    if not messages:
        return np.zeros((contacts.n_slots, n))
    time, airtime = telemetry["time"].values, np.sum(messages, axis=0)
    spent: Array = np.array([np.interp(contacts.edges_s, time, airtime[:, j]) for j in range(n)])
    share = np.diff(spent, axis=1).T / np.diff(contacts.edges_s)[:, None]
    if access is Access.ONE_AT_A_TIME:
        share = np.broadcast_to(share.sum(axis=1, keepdims=True), share.shape)
    elif access is Access.TDMA:
        share = share * n
    return np.minimum(share, 1.0)


def acts_alone(swarm: Swarm | None) -> bool:
    """Whether each sends its data knowing nothing of the others': each relays for itself, or every message is lost."""
    return swarm is not None and (parts_chosen(swarm)["relay"] == "own" or swarm.message_loss == 1.0)


def unelected_relays(scenario: Scenario, telemetry: xr.Dataset) -> Mask | None:
    """Who speaks to Earth after the flight where nobody is elected then, shape (n,); None: an election is held.

    Everybody, where each relays for itself, or has elected itself for want of messages. Where the plan says who relays, that
    one, whether it is lost or not, unless `data.election` asks for an election. Where no message arrives, whom the behaviour
    chose in flight.
    """
    swarm, modes = scenario.swarm, telemetry["mode"].values
    if swarm is None:
        return None
    relay, speaks = parts_chosen(swarm)["relay"], modes == TargetKind.EARTH
    if relay == "own" or (relay == "election" and acts_alone(swarm)):
        return np.ones(modes.shape[1], np.bool_)
    if relay == "plan" and (scenario.data.election == "flight" or acts_alone(swarm)):
        tracked = telemetry["tracked_spacecraft"].values[modes == TargetKind.SPACECRAFT]
        planned: Mask = speaks.any(axis=0) | np.isin(np.arange(modes.shape[1]), tracked)
        return planned if planned.any() else None
    return np.asarray(speaks[-1]) if acts_alone(swarm) else None
