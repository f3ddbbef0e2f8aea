"""The report as a file: whole, small, self-contained, escaped, true to the run, and clear about bad input."""

import base64
import json
import shutil
import zlib
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
import xarray as xr
from plotly.offline import get_plotlyjs

from swarm_mj.api.results import report
from swarm_mj.cli.main import main
from swarm_mj.errors import OutputError
from swarm_mj.observation.coverage import percent_digits
from swarm_mj.records.run_record import read_run
from swarm_mj.reports.page import SCRIPTS, report_html, safe_json
from swarm_mj.reports.sections import flat_parameters, short, summary_section
from swarm_mj.smallbody.geodesic import geodesic_icosahedron

MEGABYTES = 1e6


class Page(HTMLParser):
    """What a browser would make of the file."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.text, self.scripts, self._inside = [], "", [], None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag in ("script", "style"):
            self._inside = tag
            self.scripts.append("")

    def handle_endtag(self, tag):
        self._inside = None

    def handle_data(self, data):
        if self._inside:
            self.scripts[-1] += data
        else:
            self.text += data

    def ids(self):
        return {attrs["id"] for _, attrs in self.tags if "id" in attrs}

    def data(self):
        return next(json.loads(text) for text in self.scripts if text.startswith('{"ink"'))


def unpacked(array):
    return np.frombuffer(base64.b64decode(array["data"]), array["type"]).reshape(array["shape"])


@pytest.fixture(scope="module")
def crippled(folder):
    """The run, but spacecraft 1 is lost at 1000 s."""
    run = read_run(folder)
    works = np.ones(run.telemetry["mode"].shape, np.int8)
    works[run.times >= 1000.0, 0] = 0
    telemetry = run.telemetry.assign(operational=(("time", "spacecraft"), works))
    errors = {**run.summary["pointing_error_deg_final"], "sc1": 5.28}
    return replace(
        run, telemetry=telemetry, summary={**run.summary, "lost": ["sc1"], "pointing_error_deg_final": errors}
    )


@pytest.fixture(scope="module")
def page(folder):
    return Page((folder / "report.html").read_text("utf-8"))


def test_the_page_has_every_part(page):
    assert {
        "summary",
        "replay",
        "spacecraft",
        "design",
        "parameters",
        "scene-0",
        "plots",
        "slider",
        "play",
    } <= page.ids()


def test_the_page_names_the_sensors_and_how_well_they_know_the_attitude(folder, other_folder):
    ideal, cubesat = (str(summary_section(read_run(place))) for place in (folder, other_folder))
    assert "sensors: ideal</small>" in ideal and "sensors: cubesat, which know it to 0.0" in cubesat


def test_the_page_fetches_nothing(page):
    for tag, attrs in page.tags:
        assert not {"src", "srcset", "background", "action"} & set(attrs), (tag, attrs)
        assert attrs.get("href", "#").startswith("#")
        assert tag not in ("link", "iframe", "object", "img")
    policy = next(attrs["content"] for tag, attrs in page.tags if attrs.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy


def test_the_page_is_below_15_megabytes(folder, comparison):
    assert (folder / "report.html").stat().st_size < 15 * MEGABYTES
    assert comparison.stat().st_size < 15 * MEGABYTES


def test_plotly_stands_in_the_page_as_it_came_but_for_parentheses(page, folder):
    attributes = [attrs for tag, attrs in page.tags if tag in ("script", "style")]
    packed = next(text for attrs, text in zip(attributes, page.scripts, strict=True) if attrs.get("id") == "plotly")
    script, original = zlib.decompress(base64.b64decode(packed)).decode(), get_plotlyjs()
    opening = next(place for place, (there, here) in enumerate(zip(original, script, strict=False)) if there != here)
    closing = script.rindex("})));") + 1
    assert script[opening] == "(" and original[opening - 1 :].startswith("() => {")
    assert script[:opening] + script[opening + 1 : closing] + script[closing + 1 :] == original


def test_text_of_a_scenario_is_shown_and_never_run(page, folder, hostile):
    assert hostile in page.text
    assert [tag for tag, _ in page.tags].count("script") == 2 + len(SCRIPTS)
    assert not [attrs for _, attrs in page.tags if "onerror" in attrs]
    assert hostile not in (folder / "report.html").read_text("utf-8")


def test_json_in_the_page_holds_no_character_that_ends_its_element():
    text = safe_json({"a": "</script><!--", "b": "<script>", "c": "&lt;"})
    assert not set("<>&") & set(text)
    assert json.loads(text) == {"a": "</script><!--", "b": "<script>", "c": "&lt;"}


def test_every_control_has_a_name_and_every_table_a_caption(page):
    for tag, attrs in page.tags:
        if tag == "button" or attrs.get("type") == "range":
            assert attrs.get("aria-label"), (tag, attrs)
    counts = [tag for tag, _ in page.tags]
    assert counts.count("table") == counts.count("caption") > 3


def test_coverage_in_the_page_is_that_of_the_telemetry(page, folder):
    run = page.data()["runs"][0]
    times, percent = unpacked(run["times"]), unpacked(run["percent"])
    with xr.open_dataset(folder / "telemetry.nc", engine="h5netcdf") as telemetry:
        there = telemetry["coverage_percent"].sel(time=times, method="nearest").values
    assert np.allclose(percent, np.floor(100.0 * there + 1e-6) / 100.0, atol=1e-5)  # as they are written everywhere
    with np.load(folder / "coverage.npz") as coverage:
        assert np.array_equal(unpacked(run["scene"]["first_seen"]), coverage["first_seen_s"], equal_nan=True)


def test_every_spacecraft_stands_in_the_table_with_its_delta_v(page, folder):
    summary = json.loads((folder / "summary.json").read_text())
    for name, delta_v in summary["deployment_delta_v_m_s"].items():
        assert name in page.text
        assert f"{delta_v:.2f}" in page.text
    for share in summary["coverage_percent_by_spacecraft"].values():
        assert percent_digits(share) in page.text


def test_a_lost_spacecraft_is_lost_everywhere_in_the_report(crippled):
    page = Page(report_html([crippled]))
    run, modes = page.data()["runs"][0], page.data()["modes"]
    late = unpacked(run["times"]) >= 1000.0
    shown = unpacked(run["mode"])
    assert {modes[mode]["meaning"] for mode in shown[late, 0]} == {"lost"}
    assert "lost" not in {modes[mode]["meaning"] for mode in shown[~late].ravel()}
    assert np.isnan(unpacked(run["pointing"])[late, 0]).all() and not np.isnan(unpacked(run["pointing"])[:, 1]).any()
    assert (unpacked(run["scene"]["length"])[late, 0] == 0.0).all()
    assert "; lost at 1000 s" in page.text
    assert "1 lost by the end" in page.text and "1000 s: lost" in page.text
    assert "lost" in {trace.get("name") for trace in page.data()["plots"]["data"]}


def test_a_comparison_leaves_lost_spacecraft_out_of_the_pointing_error_and_counts_them(crippled, folder):
    text = report_html([crippled, read_run(folder)])
    rows = {row.split('scope="row">')[1].split("<")[0]: row for row in text.split("<tr")[1:] if 'scope="row"' in row}
    assert ">5.28<" not in rows["pointing error at the end, largest [deg]"]
    assert ">1<" in rows["spacecraft lost by the end"]


def test_turns_say_to_what_and_modes_have_their_own_colours_and_legend(page):
    assert "communication tracking with sc1" in page.text
    assert "Earth tracking" in page.text and "earth tracking" not in page.text
    curves = [trace for trace in page.data()["plots"]["data"] if trace.get("showlegend")]
    of_modes = [trace for trace in curves if trace["yaxis"] == "y4"]
    assert of_modes and all(trace["legend"] == "legend2" for trace in of_modes)
    assert not any("legend" in trace for trace in curves if trace["yaxis"] != "y4")


@pytest.mark.parametrize(
    ("value", "words"),
    [(112.34, "112"), (5.2789, "5.28"), (0.0123, "0.0123"), (1.1e-5, "1.1·10⁻⁵"), (0.0, "0"), (1234.5, "1230")],
)
def test_numbers_are_written_alike_everywhere(value, words):
    assert short(value) == words


def test_all_parameters_and_versions_are_listed(page, folder):
    run = read_run(folder)
    for key in flat_parameters(run.scenario):
        assert key in page.text, key
    for name, version in run.summary["versions"].items():
        assert name in page.text
        assert version in page.text


def test_a_comparison_marks_exactly_the_parameters_that_differ(comparison, folder, other_folder):
    flats = [flat_parameters(read_run(place).scenario) for place in (folder, other_folder)]
    page = Page(comparison.read_text("utf-8"))
    rows, key_next = {}, None
    text = comparison.read_text("utf-8")
    start = text.index('id="parameters"')
    for row in text[start:].split("<tr")[1:]:
        if 'scope="row"' in row:
            key_next = row.split('scope="row">')[1].split("<")[0]
            rows[key_next] = 'class="differs"' in row.split(">")[0] + ">"
    for key in set(flats[0]) | set(flats[1]):
        assert rows[key] == (flats[0].get(key) != flats[1].get(key)), key
    assert rows["camera.half_angle_deg"] and rows["control.controller"] and not rows["epoch"]
    assert {"scene-0", "scene-1", "now-0", "now-1"} <= page.ids()


def test_the_choice_of_pictures_that_count_says_so_where_two_runs_count_differently(comparison, folder, other_folder):
    runs = [read_run(place) for place in (folder, other_folder)]
    assert [run.scenario.observation.criterion for run in runs] == ["passage", "arrival"]
    assert ">as each run counts</option>" in comparison.read_text("utf-8")
    both = report_html([runs[1], runs[1]])
    assert ">at the arrival</option>" in both and "as each run counts" not in both
    assert ">at the arrival</option>" not in report_html([runs[0]])


def test_a_run_beside_itself_differs_in_nothing(folder):
    run = read_run(folder)
    assert 'class="differs"' not in report_html([run, run])


def test_points_that_are_given_outright_come_without_a_proof(page):
    assert "no record of a design" in page.text
    assert "Proven" not in page.text


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda f: shutil.rmtree(f), "no such folder"),
        (lambda f: (f / "summary.json").unlink(), "unfinished run"),
        (lambda f: [p.unlink() for p in f.iterdir()], "not a folder of `swarm-mj fly`"),
        (lambda f: (f / "scenario.yaml").write_text("name: x\ncolour: red"), "colour: unknown key"),
        (lambda f: (f / "summary.json").write_text('{"scenario": "x", "proof": {}}'), "describes a design"),
    ],
)
def test_bad_input_is_named(folder, tmp_path, spoil, words):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    spoil(copy)
    with pytest.raises(OutputError, match=words):
        report([copy], tmp_path / "report.html")
    assert not (tmp_path / "report.html").exists()


def test_a_file_and_three_runs_are_refused(folder, tmp_path):
    with pytest.raises(OutputError, match="is a file"):
        report([folder / "summary.json"])
    with pytest.raises(OutputError, match="not 3"):
        report([folder] * 3)
    with pytest.raises(OutputError, match="is a folder"):
        report([folder], tmp_path)


def test_a_report_that_cannot_be_finished_leaves_the_earlier_one(folder, tmp_path, monkeypatch):
    path = tmp_path / "report.html"
    path.write_text("earlier")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("swarm_mj.io.atomic.os.replace", full)
    with pytest.raises(OutputError, match="No space left"):
        report([folder], path)
    assert path.read_text() == "earlier"


def test_a_run_ends_with_the_path_of_its_report_unless_told_not_to(tmp_path, capsys):
    short = ["duration_s=600", "telemetry.interval_s=60", "observation.interval_s=600"]
    command = ["fly", "eros-quick", "--no-figures", "--quiet", *(part for key in short for part in ("--set", key))]
    assert main([*command, "--out", str(tmp_path / "with")]) == 0
    assert capsys.readouterr().out.strip().endswith(str(tmp_path / "with" / "report.html"))
    assert (tmp_path / "with" / "report.html").is_file()
    assert main([*command, "--no-report", "--out", str(tmp_path / "without")]) == 0
    assert "report" not in capsys.readouterr().out
    assert not (tmp_path / "without" / "report.html").exists()


def test_the_command_writes_where_it_is_told_and_ends_with_an_error_for_no_run(folder, tmp_path, capsys):
    assert main(["report", str(folder), "--out", str(tmp_path / "deep" / "mine.html")]) == 0
    assert (tmp_path / "deep" / "mine.html").read_text("utf-8").startswith("<!DOCTYPE html>")
    assert main(["report", str(tmp_path / "nothing")]) == 2
    assert "no such folder" in capsys.readouterr().err


@pytest.mark.slow
def test_a_thousand_spacecraft_over_a_fine_mesh_stay_below_15_megabytes(folder):
    run = read_run(folder)
    n, samples = 1000, 2000
    places = np.linspace(0, len(run.times) - 1, samples).astype(int)
    telemetry = run.telemetry.isel(time=places).assign_coords(time=np.linspace(0.0, 1200.0, samples))
    telemetry = telemetry.isel(spacecraft=np.arange(n) % run.n).assign_coords(
        spacecraft=[f"sc{j + 1}" for j in range(n)]
    )
    (ground, ground_faces), (target, cells) = geodesic_icosahedron(100), geodesic_icosahedron(40)
    by = np.full((n, len(cells)), np.nan)
    by[:2, ::2] = 600.0
    seen = np.where(np.arange(len(cells)) % 2, np.nan, 600.0)
    coverage = dict(
        run.coverage, vertices=5e3 * target, faces=cells, area=np.ones(len(cells)), first_seen_s=seen,
        first_seen_by_s=by, first_seen_s_passage=seen, first_seen_by_s_passage=by, body_vertices=9e3 * ground,
        body_faces=ground_faces, face_of_cell=np.arange(len(cells)), gsd_m=by / 600.0, incidence_deg=by / 60.0,
        why=np.zeros(len(cells), np.int8), weight=np.ones(len(cells)),
    )  # fmt: skip
    by_name = {
        key: {name: next(iter(value.values()), 0.0) for name in telemetry["spacecraft"].values}
        for key, value in run.summary.items()
        if isinstance(value, dict) and "sc1" in value
    }
    summary = {**run.summary, **by_name, "observers": n, "spacecraft": n}
    design = run.scenario.design.model_copy(update={"visiting_points": tuple(range(1, n + 1))})
    scenario = run.scenario.model_copy(update={"design": design})
    large = replace(run, telemetry=telemetry, coverage=coverage, summary=summary, scenario=scenario, delivery=None)
    text = report_html([large, large])
    assert len(text) < 15 * MEGABYTES  # one of the two alone is shorter
    rows = text.split('id="now-0"')[1].split("</table>")[0]
    assert "(20 of 1000 spacecraft shown)" in rows and "sc19<" in rows and "sc20<" not in rows and "sc1000<" in rows
    assert f'"rows":[{",".join(map(str, range(19)))},399]' in text


def test_the_target_of_a_small_body_is_not_rounded_away(folder):
    run = read_run(folder)
    text = report_html([replace(run, summary={**run.summary, "target_area_km2": 0.0155})])
    assert "0.0155 km²" in text and "0.02 km²" not in text
