"""Write docs/results/pixel_to_earth.md, what of the paper's mission reaches Earth: python -m scripts.pages.pixel_to_earth."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from scripts.pages import RESULTS
from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.dataflow.ground import NETWORKS
from swarm_mj.dataflow.link_budget import carrier_to_noise_db_hz, free_space_loss_db, rates_bit_s
from swarm_mj.dataflow.radios import CATALOGUE, Radio
from swarm_mj.flight.downlink import deliver
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import ObservationResult, observe_flight
from swarm_mj.flight.plan import Plan, make_plan
from swarm_mj.io.atomic import write_text
from swarm_mj.observation.coverage import percent_digits, percent_text, rounded_up_digits
from swarm_mj.records.delivered import delivered_summary
from swarm_mj.scenarios.constants import AU, SPEED_OF_LIGHT
from swarm_mj.scenarios.loading import load_scenario

PAGE = RESULTS / "pixel_to_earth.md"
HEMISPHERE = {"link.crosslink.antenna": "hemispherical"}
MEDOID = {"behavior.parameters.election": "medoid"}
#: A pixel of 10 cm from 14 km, and 20 days to send what it gives.
TEN_CM = {"camera.detector_ifov_rad": 7.142857e-6, "data.horizon_s": 1728000}
#: What is sent anew, with the flight as it was: words, scenario and changes.
CASES: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("omnidirectional, the default", "eros-config1", {}),
    ("one hemisphere", "eros-config1", HEMISPHERE),
    ("omnidirectional", "eros-config2", {}),
    ("one hemisphere", "eros-config2", HEMISPHERE),
    ("one hemisphere, the medoid relays", "eros-config2", {**HEMISPHERE, **MEDOID}),
    (
        "the same, nothing sent after the flight",
        "eros-config2",
        {**HEMISPHERE, **MEDOID, "data.horizon_s": 0},
    ),
    ("one hemisphere, election by delivery", "eros-config2", {**HEMISPHERE, "data.election": "delivery"}),
    ("the window of the detector around the target", "eros-config1", {"data.product": "window"}),
    ("the pixels of its cells alone", "eros-config1", {"data.product": "cells"}),
    ("the same, one hemisphere", "eros-config1", {"data.product": "cells", **HEMISPHERE}),
    ("dishes of 34 m on Earth", "eros-config1", {"link.ground.network": "dsn34"}),
    ("a small array of patches to Earth", "eros-config1", {"link.earth.radio": "iris_patch_array"}),
    ("one patch to Earth", "eros-config1", {"link.earth.radio": "iris_patch"}),
    ("storage of 500 kbit", "eros-config1", {"data.storage_bit": 500000}),
    ("pixels of 10 cm, 20 days", "eros-config1", TEN_CM),
)

TEXT = """# From pixel to Earth

`swarm-mj fly` follows every qualifying image to the ground: how many bits it is, who holds it, which radio can send it
where, and when the last bit of it is on Earth. This page is written by `python -m scripts.pages.pixel_to_earth`, which
flies `eros-config1` and `eros-config2`, the package's readings of the paper's two configurations (camera of 4.1 deg
half-angle, the instant of the arrival alone), and sends what they saw in different ways.

{first}

## From pictures to bits

Of each cell that several pictures of a spacecraft show, it keeps the one of the finest ground sampling distance
(`data.pictures`): that distance and its light are told, and its data are sent. By default whole pictures are sent, a pixel at
`data.bits_per_pixel` / `data.compression` = 1 bit; with `data.product: window` the rectangle of the detector around the cells
that are kept by a picture, with `cells` their pixels alone (each cell its area, foreshortened, over the square of the ground
sampling distance). A picture's bits are shared out over its cells. Cells that the same pictures show make a *tile*, which is
what is stored, sent and counted; of a tile that several spacecraft saw the finest copy that can arrive is sent, once.

## Radios

{radios}

Rates follow from C/N0 = EIRP - losses - 20 lg(4 pi r f / c) + G/T - 10 lg k and the Eb/N0 that the code needs, with a
margin of 3 dB, in the steps that the radio knows, and never above Shannon's capacity. To Earth (dishes of 70 m; the number
in brackets is for 34 m):

{budget}

MarCO sent 8 kbit/s to a dish of 70 m from Mars, 1.05 au away. Eros is {earth_au:.2f} au from Earth at the scenario's epoch,
so that light takes {light_min:.1f} minutes.

## What arrives

All numbers include light time and are past the deployment; the arrival is at 600 s and the flight ends at 1,200 s. "Alone" is
what the swarm delivers by itself (nearest relay, finest copy, most area per bit first, knowing only links that are closed
now); "at most" is the bound of a linear program over all schedules, from its dual prices, whichever copies they send; no
schedule delivers more than was seen.

| what differs | scenario | seen [%] | alone [%] | at most [%] | all that was seen [h] | at the earliest [h] | why not all |
|---|---|---|---|---|---|---|---|
{rows}

The relay's one hemisphere cannot hear spacecraft on its Earthward side: their dishes point at it and it looks away. That
stays so for as long as the swarm drifts apart along straight lines, and no amount of time helps. Two antennas back to back,
or an omnidirectional one, do; so can another relay.

## What is assumed

- Pointing is as flown until the end of the flight, and after it perfect but for who tumbles: relays point at Earth, others at
  the nearest relay. The Earth antenna's gain is taken over all of `link.dish_half_angle_deg`.
- After the flight the spacecraft fly on in the same force field without burns; who hits the body is lost.
- Omnidirectional crosslinks carry data while the observers still look at the body.
- Earth hears the station of the network that is most sensitive of those that see the swarm at
  `link.ground.min_elevation_deg` or more, at the time of reception; nobody else uses it. UT1 is taken as UTC. There is no
  weather, and no uplink.
- For more than 12 spacecraft the bounds hold for schedules over links to relays and to three neighbours each; for more than 200
  nothing is computed.
- Of a picture the share of those cells that another spacecraft's copy delivers stays aboard: pictures can be sent in parts.
- Inventories of who holds which tile, acknowledgements and commands take no bits.
- Slots are `data.slot_s` long, growing to half an hour after the last picture; what is received in a slot is sent on in the
  next.
- Noise temperatures, losses and margins of the catalogue's radios are those of their class where no figure is published;
  the sources stand in `swarm_mj/dataflow/radios.py` and `ground.py`.
"""


def main() -> None:
    """Fly, send and write the page."""
    flights: dict[tuple[str, ...], tuple[Plan, xr.Dataset, ObservationResult]] = {}
    rows, first = [], ""
    for words, name, changes in CASES:
        in_flight = {key: value for key, value in changes.items() if key.startswith("behavior")}
        plan, telemetry, result = flights.setdefault((name, *in_flight), flown(name, in_flight))
        plan = replace(plan, scenario=load_scenario(name, changes))
        delivery = deliver(plan, telemetry, result.kept)
        assert delivery is not None
        summary = delivered_summary(plan, replace(result, delivery=delivery))
        rows.append(row(words, name, result.coverage.percent, summary))
        first = first or lead(summary, delivery)
        print(rows[-1], flush=True)
    earth_m = float(np.linalg.norm(plan.environment.earth.position))
    text = TEXT.format(
        first=first,
        radios="\n".join(radio_rows()),
        budget="\n".join(budget_rows()),
        earth_au=earth_m / AU,
        light_min=earth_m / SPEED_OF_LIGHT / 60.0,
        rows="\n".join(rows),
    )
    write_text(PAGE, text)
    print(f"wrote {PAGE}")


def flown(name: str, changes: Mapping[str, Any]) -> tuple[Plan, xr.Dataset, ObservationResult]:
    """A scenario flown and judged."""
    plan = make_plan(load_scenario(name, changes))
    telemetry = simulate(plan)
    return plan, telemetry, observe_flight(plan, telemetry)


def lead(summary: dict, delivery: Delivery) -> str:
    """The headline, with what it does not cover."""
    complete = "complete" if summary["time_to_full_map_s"] is not None else "all that was seen"
    spoken = summary["time_to_all_data_s"] - delivery.light_time_s[0]
    words = (
        f"`eros-config1` delivers **{percent_text(summary['delivered_percent'])} of the target**, {complete} on Earth "
        f"**{summary['time_to_all_data_s']:.0f} s after deployment** ({spoken:.0f} s of flight and "
        f"{delivery.light_time_s[0]:.0f} s of light time): {summary['delivered_bits'] / 1e6:.2f} Mbit of the "
        f"{summary['seen_bits'] / 1e6:.2f} Mbit that were seen, "
        f"{summary['aboard_bits'] / 1e6:.2f} Mbit of which are copies that stay aboard. A pixel of what arrives covers "
        f"{_spread(summary['gsd_delivered_m'])} m (least, median, most). Bits are few because a pixel of this camera "
        "covers 4 m or more of the ground; with the 10 cm that the paper asks for it takes days, see the last row below."
    )
    return textwrap.fill(words, 120, break_long_words=False, break_on_hyphens=False)


def _spread(values: Mapping[str, float]) -> str:
    return ", ".join(f"{value:.3g}" for value in values.values())


def row(words: str, name: str, seen: float, summary: dict) -> str:
    """A line of the table of what arrives."""
    parts = ", ".join(f"{rounded_up_digits(part['percent'])} % {part['reason']}" for part in summary["not_delivered"])
    delivered = percent_digits(summary["delivered_percent"])
    bound = rounded_up_digits(summary["delivered_percent_bound"])
    return (
        f"| {words} | `{name}` | {percent_digits(seen)} | {delivered} | {bound} | "
        f"{hours(summary['time_to_all_data_s'])} | {hours(summary['time_to_all_data_s_bound'])} | {parts or '-'} |"
    )


def hours(seconds: float | None) -> str:
    """Seconds as hours; a dash for never."""
    return "-" if seconds is None else f"{seconds / 3600.0:.2f}"


def radio_rows() -> Iterator[str]:
    """The catalogue."""
    yield "| radio | band | EIRP [dBW] | losses [dB] | Eb/N0 needed [dB] | rates [bit/s] | beam, half [deg] |"
    yield "|---|---|---|---|---|---|---|"
    for radio in CATALOGUE.values():
        rates = f"{radio.rates_bit_s[0]:,g} to {radio.rates_bit_s[-1]:,g}"
        yield (
            f"| `{radio.name}` | {radio.band} | {radio.eirp_dbw:.1f} | {radio.losses_db:.1f} | {radio.required_eb_n0_db:.1f} | "
            f"{rates} | {radio.half_beam_deg:g} |"
        )


def budget_rows() -> Iterator[str]:
    """The link to Earth by distance."""
    radio: Radio = CATALOGUE["iris_reflectarray"]
    large, small = (NETWORKS[name][0].g_over_t_db_k for name in ("dsn", "dsn34"))
    yield "| distance [au] | free space [dB] | C/N0 [dB Hz] | rate [bit/s] |"
    yield "|---|---|---|---|"
    for au in (0.1, 0.3, 1.0, 1.05, 2.0, 2.7):
        range_m = au * AU
        yield (
            f"| {au:g} | {float(free_space_loss_db(range_m, radio.frequency_hz)):.1f} | "
            f"{float(carrier_to_noise_db_hz(radio, large, range_m)):.1f} | "
            f"{float(rates_bit_s(radio, large, range_m)):,g} ({float(rates_bit_s(radio, small, range_m)):,g}) |"
        )


if __name__ == "__main__":
    main()
