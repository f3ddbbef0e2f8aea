"""A scenario flown: `fly` makes a `Flight`, which shows, films, saves and reports itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import pandas as pd
import xarray as xr

from swarm_mj.api.display import Plots, figure_html, rows_html
from swarm_mj.api.scenario import Scenario, load
from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.figures.drawing import compile_in_background, composers, draw_all, figures_of, prepare_drawing
from swarm_mj.flight.compile_ahead import kernels_compiled
from swarm_mj.flight.downlink import deliver
from swarm_mj.flight.fast_releases import release_findings
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import ObservationResult, add_coverage, observe_flight, picture_count
from swarm_mj.flight.plan import Plan, behavior_from, check_plugins, make_plan
from swarm_mj.io.atomic import Result, atomic_folder, check_place
from swarm_mj.io.progress import Forecast, Shown, Stages, using_bars
from swarm_mj.observation.coverage import CoverageMap, percent_text
from swarm_mj.records.cells import cells_table
from swarm_mj.records.observed import when_text
from swarm_mj.records.run_files import coverage_arrays, flown_design, write_results, write_summary
from swarm_mj.records.run_record import RunRecord, read_run
from swarm_mj.records.summary import summarise
from swarm_mj.scenarios import schema
from swarm_mj.scenarios.loading import NO_OVERRIDES, ScenarioSource

if TYPE_CHECKING:
    pass


@dataclass(eq=False, repr=False)
class Flight:
    """What a swarm did and saw.

    Attributes:
        plan: Target, trajectories and plug-ins that were flown.
        telemetry: Samples of the whole flight, an `xarray.Dataset` with `units` and `frame` on every variable.
        result: What the cameras saw, by the scenario's criterion and over the whole passage.
        summary: The numbers a reader asks for first, as in summary.json.
        design: The record of the design that was flown; None: the points are nobody's design.
        folder: Where it is saved; None: nowhere yet.
    """

    plan: Plan
    telemetry: xr.Dataset
    result: ObservationResult
    summary: dict[str, Any]
    _: KW_ONLY
    design: dict[str, Any] | None = None
    folder: Path | None = None

    @property
    def scenario(self) -> Scenario:
        """The scenario that was flown."""
        return Scenario.of(self.plan.scenario)

    @property
    def coverage(self) -> CoverageMap:
        """What was observed by the scenario's criterion: `.percent`, `.seen`, `.first_seen_s`, `.seen_by`."""
        return self.result.coverage

    @property
    def passage(self) -> CoverageMap:
        """What was observed over the whole passage inside the imaging region."""
        return self.result.passage

    @property
    def delivered(self) -> Delivery | None:
        """What reaches Earth: `.arrives_s` of each cell, `.sent_bit`, `.aboard_bit`, `.undelivered()`; None: not computed."""
        return self.result.delivery

    @property
    def spacecraft(self) -> pd.DataFrame:
        """One row a spacecraft: what it visits, its share of the target [%], delta-v [m/s], pointing error at the end [deg]."""
        summary, points = self.summary, self.summary["visiting_points"]
        table = pd.DataFrame(
            {
                "visiting_point": pd.Series(dict(zip(self.plan.names, points, strict=False)), dtype="Int64"),
                "observed_percent": summary["coverage_percent_by_spacecraft"],
                "delta_v_m_s": summary["deployment_delta_v_m_s"],
                "pointing_error_deg": summary["pointing_error_deg_final"],
                "link_closed_percent": summary["link_closed_percent"],
            },
            index=list(self.plan.names),
        )
        return table.assign(lost=[name in summary["lost"] for name in table.index]).rename_axis("spacecraft")

    @property
    def cells(self) -> pd.DataFrame:
        """One row a cell of the target; columns with units as `swarm_mj.records.cells.QUANTITIES` says."""
        return cells_table(coverage_arrays(self.plan, self.result), self.delivered)

    @property
    def events(self) -> pd.DataFrame:
        """What went wrong, in order of time: faults, losses, impacts; empty where nothing did."""
        return pd.DataFrame(self.summary["events"])

    @property
    def findings(self) -> list[str]:
        """What to know before believing the numbers, one sentence each."""
        from swarm_mj.records.findings import findings

        return findings(self.record)

    @property
    def record(self) -> RunRecord:
        """The flight as plain data: what reports are made of."""
        return RunRecord(
            folder=self.folder or Path(),
            summary=self.summary,
            scenario=self.plan.scenario,
            telemetry=self.telemetry,
            coverage=coverage_arrays(self.plan, self.result),
            design=self.design,
            delivery=self.result.delivery,
        )

    @property
    def plot(self) -> Plots:
        """The figures of the flight by name, e.g. `flight.plot.coverage()`; each returns its Matplotlib axes."""
        here = self.plan, self.telemetry, self.result
        return Plots({name: partial(compose, *here) for name, compose in composers(self.telemetry).items()})

    def save(
        self,
        folder: str | Path,
        *,
        figures: bool = True,
        pdf: bool = False,
        report: bool = True,
        progress: Shown = None,
    ) -> Path:
        """Write the flight into a folder that appears only when all is done.

        Args:
            folder: Where; an earlier flight of the same scenario is replaced, anything else is refused.
            figures: Whether to write the figures as PNG, and with `pdf` as PDF too.
            pdf: See `figures`.
            report: Whether to write report.html.
            progress: Whether to show progress bars, or the bars to use; None: on a terminal and in notebooks, after 2 s.

        Returns:
            The folder.

        Raises:
            OutputError: The folder cannot be written or holds something else.
        """
        with using_bars(progress) as bars:
            stages = Stages(self.plan.scenario.name, bars)
            stages.wall_s = dict(self.summary["wall_s"])
            if figures:
                prepare_drawing()
            with atomic_folder(Path(folder), _result_of(self.plan.scenario), stages.say) as partial_folder:
                _write(partial_folder, self, stages, figures=figures, pdf=pdf)
            self.folder = Path(folder)
            if report:
                _write_report(self.folder, stages)
        return self.folder

    def report(self, path: str | Path, *, beside: Flight | None = None) -> Path:
        """Write the flight, or two side by side, as one HTML file that opens in any browser without a network.

        Raises:
            OutputError: The file cannot be written.
        """
        from swarm_mj.reports.page import write_report

        return write_report([self.record, *([] if beside is None else [beside.record])], Path(path))

    def video(
        self,
        path: str | Path,
        *,
        camera: str = "overview",
        fps: float = 25.0,
        size: tuple[int, int] | None = None,
        speed: float | None = None,
        span_s: tuple[float | None, float | None] | None = None,
        progress: Shown = None,
    ) -> Path:
        """Make a film of the flight, or stills of its arrival and end.

        Args:
            path: File that ends in .mp4 or .gif, or in .png for stills.
            camera: `overview`, `chase`, `split`, or `sc1`, `sc2`, ... beside an overview.
            fps: Pictures per second of film.
            size: Width and height [pixel]; None: one that suits the camera.
            speed: Seconds of flight per second of film; None: so that the film lasts about half a minute.
            span_s: Begin and end of what is shown [s], each None for the flight's own; None: all of it, or the encounter where
                that is a small part of the flight.
            progress: Whether to show progress bars, or the bars to use; None: on a terminal and in notebooks, after 2 s.

        Raises:
            OutputError: The camera does not exist, or the film cannot be encoded or written.
            ObserverError: OpenGL cannot be loaded here.
        """
        from swarm_mj.rendering.film import make_film
        from swarm_mj.rendering.replay import Replay

        replay = Replay(self.plan, self.telemetry, self.coverage.first_seen_s, self.delivered)
        with using_bars(progress) as bars:
            film = make_film(
                replay, Path(path), camera=camera, fps=fps, size=size, speed=speed, span_s=span_s, bars=bars
            )
        return film.path

    def export(self, folder: str | Path, formats: Sequence[str] = ("all",), *, ccsds: Literal[2, 3] = 2) -> list[Path]:
        """Write the flight in the formats of other programs; see the page "Take results elsewhere".

        Args:
            folder: Where; an earlier export is replaced, anything else is refused.
            formats: `oem`, `aem` (CCSDS messages), `spk`, `ck`, `dsk` (SPICE kernels and what belongs to them), `gltf`,
                `csv`, or `all`.
            ccsds: Version of the messages: 2 (OEM 2.0, AEM 1.0) or 3 (OEM 3.0, AEM 2.0).

        Returns:
            The files.

        Raises:
            InteropError: A format is unknown or needs a package that is not installed.
            OutputError: The folder cannot be written or holds something else.
        """
        from swarm_mj.interop.export import export_flight
        from swarm_mj.interop.states import FlightStates

        return export_flight(FlightStates(self.plan, self.telemetry), Path(folder), formats, ccsds)

    def products(
        self, folder: str | Path, formats: Sequence[str] = ("all",), *, pixel_m: float | None = None
    ) -> list[Path]:
        """Write maps of the target for other programs; see the page "Maps for other programs".

        Args:
            folder: Where; earlier products are replaced, anything else is refused.
            formats: `parquet` (one row a cell), `geotiff` (every quantity, equirectangular and polar), `ply`, `obj` (the body
                with attributes), `dsk` (SPICE), `png` (panels), or `all`.
            pixel_m: Side of a pixel of the GeoTIFFs [m]; None: a third of a median cell's side.

        Returns:
            The files.

        Raises:
            InteropError: A format is unknown or needs a package that is not installed, or pixel_m is impossible.
            OutputError: The folder cannot be written or holds something else.
        """
        from swarm_mj.interop.states import FlightStates
        from swarm_mj.products.write import write_products

        states = FlightStates(self.plan, self.telemetry)
        return write_products(states, self.cells, Path(folder), formats, pixel_m=pixel_m)

    def images(
        self,
        folder: str | Path,
        formats: Sequence[str] = ("png",),
        *,
        labels: bool = True,
        every_s: float | None = None,
        spacecraft: Sequence[int] | None = None,
        progress: Shown = None,
    ) -> list[Path]:
        """Write the pictures of the cameras as their detectors read them out, with labels; see the page "Light and pictures".

        Args:
            folder: Where; earlier images are replaced, anything else is refused.
            formats: `png`, `fits` (extra `fits`), or `all`.
            labels: Whether to write face, depth, normal, incidence, emission, phase, light and target of every pixel.
            every_s: Least time between two pictures of a spacecraft [s]; None: all by which the criterion judges.
            spacecraft: Whose, from 1; None: everybody's.
            progress: Whether to show progress bars, or the bars to use; None: on a terminal and in notebooks, after 2 s.

        Raises:
            InteropError: A format is unknown or needs a package that is not installed, or nothing was asked for.
            OutputError: The folder cannot be written or holds something else.
            ScenarioError: It is not known how the body reflects light.
        """
        from swarm_mj.interop.states import FlightStates
        from swarm_mj.products.images import write_images

        states = FlightStates(self.plan, self.telemetry)
        with using_bars(progress) as bars:
            stages = Stages(self.plan.scenario.name, bars)
            with stages.stage("images", "pictures", picture_count(self.plan, self.telemetry)) as done:
                return write_images(
                    states, Path(folder), formats, labels=labels, every_s=every_s, spacecraft=spacecraft, progress=done
                )

    def __repr__(self) -> str:
        """One line: what was flown and what it saw."""
        share = f"{percent_text(self.coverage.percent)} of the target observed"
        return f"Flight({self.plan.scenario.name!r}, {self.plan.n} spacecraft, {share} {when_text(self.summary)})"

    def _repr_html_(self) -> str:
        """For notebooks: a short table and the picture of the operation."""
        from swarm_mj.figures.run_figures import COMPOSERS

        plan, summary = self.plan, self.summary
        rows = [
            (f"observed area, {when_text(summary)}", percent_text(self.coverage.percent)),
            ("the same, whole passage", percent_text(self.passage.percent)),
            *(
                [("delivered to Earth", f"{percent_text(summary['delivered_percent'])} of the target")]
                if summary.get("delivered_percent") is not None
                else []
            ),
            ("spacecraft, of them observers", f"{plan.n}, {plan.n_observers}"),
            ("deployment delta-v, at most", f"{max(summary['deployment_delta_v_m_s'].values()):.2f} m/s"),
            ("wheel speed, at most", f"{100 * summary['max_wheel_speed_fraction']:.0f} % of the limit"),
            *[("note", words) for words in self.findings],
        ]
        picture = figure_html(partial(COMPOSERS["operation"], plan, self.telemetry, self.result))
        return rows_html(f"Flight of {plan.scenario.name}", plan.scenario.description, rows) + picture


def fly(
    scenario: ScenarioSource,
    overrides: Mapping[str, Any] = NO_OVERRIDES,
    *,
    out: str | Path | None = None,
    figures: bool = True,
    pdf: bool = False,
    report: bool = True,
    progress: Shown = None,
) -> Flight:
    """Fly a scenario and judge what its cameras saw.

    Args:
        scenario: What to fly, as `load` takes it.
        overrides: Values by dotted key that change it, e.g. `{"camera.half_angle_deg": 6}`.
        out: Folder for the results, held while the flight is under way, which appears only when all is done; None: nothing is
            written, see `Flight.save`.
        figures: Whether to write the figures into the folder as PNG, and with `pdf` as PDF too.
        pdf: See `figures`.
        report: Whether to write report.html into the folder.
        progress: Whether to show progress bars, or the bars to use; None: on a terminal and in notebooks, after 2 s.

    Raises:
        SwarmError: The scenario cannot be flown or the folder cannot be written.
    """
    scenario = load(scenario, overrides)
    check(scenario, out)
    with using_bars(progress) as bars:
        stages = Stages(scenario.name, bars)
        if out is None:
            return _fly(scenario, stages)
        if figures:
            prepare_drawing()
        with atomic_folder(Path(out), _result_of(scenario), stages.say) as partial_folder:
            flight = _fly(scenario, stages)
            _write(partial_folder, flight, stages, figures=figures, pdf=pdf)
        flight.folder = Path(out)
        if report:
            _write_report(flight.folder, stages)
        return flight


def check(scenario: schema.Scenario, out: str | Path | None = None) -> None:
    """See that a scenario's plug-ins are there and that its results may be written, before anything is flown.

    Raises:
        SwarmError: Something is refused; the message says what and how to mend it.
    """
    check_plugins(scenario)
    behavior_from(scenario)
    if out is not None:
        check_place(Path(out), _result_of(scenario))


def _result_of(scenario: schema.Scenario) -> Result:
    return Result("run", scenario.name)


def _fly(scenario: schema.Scenario, stages: Stages) -> Flight:
    with stages.stage("design", "trajectories (compiles on first use)"):
        before = kernels_compiled()
        plan = make_plan(scenario)
    if kernels_compiled() > before:
        compile_in_background(plan)
    steps = round(scenario.duration_s / scenario.physics.timestep_s)
    with stages.stage("simulate", "flight", scenario.duration_s) as done:
        words = f"the flight of {plan.n} spacecraft, {steps:,} steps each,"
        telemetry = simulate(plan, Forecast(words, scenario.duration_s, done, stages.say))
    with stages.stage("coverage", "images", picture_count(plan, telemetry)) as done:
        result = observe_flight(plan, telemetry, done)
        add_coverage(telemetry, result)
    with stages.stage("delivery", "way to Earth"):
        result = replace(result, delivery=deliver(plan, telemetry, result.kept))
    summary = summarise(plan, telemetry, result, {"figures": 0.0, **stages.wall_s})
    # Of runs alone: what would do is planned, which a campaign's flights would wait for.
    summary["deployment_findings"] = release_findings(plan)
    return Flight(plan, telemetry, result, summary, design=flown_design(scenario))


def _write(folder: Path, flight: Flight, stages: Stages, *, figures: bool, pdf: bool) -> None:
    write_results(folder, flight.plan, flight.telemetry, flight.result, flight.design)
    if figures:
        with stages.stage("figures", "figures", len(figures_of(flight.telemetry))) as done:
            draw_all(folder, flight.plan, flight.telemetry, flight.result, pdf=pdf, progress=done)
    flight.summary["wall_s"] |= {stage: round(seconds, 3) for stage, seconds in stages.wall_s.items()}
    write_summary(folder, flight.summary)


def _write_report(folder: Path, stages: Stages) -> None:
    from swarm_mj.reports.page import write_report

    with stages.stage("report", "report"):
        write_report([read_run(folder)])
