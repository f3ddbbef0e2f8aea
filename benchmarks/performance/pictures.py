"""Films and reports: pictures drawn per second, how large a report is, and how soon a browser has it ready."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from time import perf_counter, sleep

import numpy as np

from benchmarks.measure import Row, row
from swarm_mj.observation.gl_context import gl_available
from swarm_mj.records.run_record import read_run
from swarm_mj.rendering.picture import Drawing
from swarm_mj.rendering.replay import load_replay
from swarm_mj.rendering.video import film
from swarm_mj.reports.page import write_report

GROUP = "pictures"
SIZE, CAMERAS = (640, 480), ("overview", "chase")
#: Pictures in a round, rounds, and how often the page is opened.
PICTURES, ROUNDS, OPENINGS = 60, 7, 5
#: Longest wait for a page [s].
PATIENCE_S = 60.0
#: Time between two questions whether it is ready [s]; without a pause they would keep a core busy that the browser needs.
BETWEEN_QUESTIONS_S = 0.05
_BROWSER = (
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--window-size=1280,900",
)


def rows(quick: bool) -> Iterator[Row]:
    """All of it, on a flight of `eros-quick` or of the paper's first configuration."""
    scenario = "eros-quick" if quick else "eros-config1"
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        command = [
            sys.executable,
            "-m",
            "swarm_mj.cli.main",
            "fly",
            scenario,
            "--quiet",
            "--no-figures",
            "--out",
            str(run),
        ]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        if gl_available()[0]:
            for camera in CAMERAS[:1] if quick else CAMERAS:
                yield _film_row(run, camera, 3 if quick else ROUNDS)
        start = perf_counter()
        page = write_report([read_run(run)], Path(folder) / "report.html")
        yield row(GROUP, "a report is written in", np.array([perf_counter() - start]), "s")
        yield row(GROUP, "its size", np.array([page.stat().st_size / 2**20]), "MiB", "<= 15")
        yield from _page_rows(page, 2 if quick else OPENINGS)


def _film_row(run: Path, camera: str, rounds: int) -> Row:
    """Pictures per second of a film, drawn and encoded, set-up excluded."""
    replay, rates = load_replay(run), []
    width, height = SIZE
    times = iter(np.linspace(replay.times[0], replay.times[-1], (rounds + 1) * PICTURES))
    with (
        tempfile.TemporaryDirectory() as folder,
        Drawing(replay.plan, replay.path_N, camera=camera, width=width, height=height, note="") as drawing,
        film(Path(folder) / "film.mp4", width=width, height=height, fps=25.0) as reel,
    ):
        for _ in range(rounds + 1):
            start = perf_counter()
            for _ in range(PICTURES):
                reel.add(drawing.draw(replay.at(float(next(times)))))
            rates.append(PICTURES / (perf_counter() - start))
    name = f"film, {camera}, {width} x {height}, without shadows"
    return row(GROUP, name, np.array(rates[1:]), "pictures/s", ">= 25", gl_available()[1])


def _page_rows(page: Path, openings: int) -> Iterator[Row]:
    """How soon the page can be used, by its own clock, in a browser without a GPU; nothing where there is no browser."""
    browser, driver = shutil.which("chromium"), shutil.which("chromedriver")
    try:
        webdriver = import_module("selenium.webdriver")
    except ImportError:
        return
    if browser is None or driver is None:
        return
    times = []
    for _ in range(openings):
        options = webdriver.ChromeOptions()
        options.binary_location = browser
        for argument in _BROWSER:
            options.add_argument(argument)
        window = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
        try:
            window.get(page.as_uri())
            start, ready = perf_counter(), None
            while ready is None and perf_counter() - start < PATIENCE_S:
                ready = window.execute_script("return document.body.dataset.ready || null")
                sleep(BETWEEN_QUESTIONS_S)
            times.append(float(ready) / 1e3 if ready is not None else PATIENCE_S)
        finally:
            window.quit()
    yield row(
        GROUP, "the page is ready after", np.array(times), "s", "<= 3", f"{Path(browser).name}, drawn without a GPU"
    )
