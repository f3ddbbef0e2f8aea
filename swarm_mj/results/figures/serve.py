"""Works for another process, see `results/drawing.py`: jobs come on the standard input, answers go to the standard output.

Jobs are pickles. ("draw", (folder, plan, telemetry, result, pdf)) is shared out to children, which are forked when it comes
and end with it: nothing here opens a GL context or starts a thread, so that they can be. They take figures from a queue. An
answer is a line, a pickle in base64 of (name, error, words): a figure that is drawn, an error, or (None, None, "") at the end.
("compile", plan) is done by a child on the side, without an answer, see `flight/compile_ahead.py`.
"""

from __future__ import annotations

import gc
import os
import pickle
import select
import sys
import traceback
from base64 import b64encode
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from swarm_mj.flight.compile_ahead import compile_ahead
from swarm_mj.results.figures import composers, draw
from swarm_mj.results.figures.numbering import name_beside
from swarm_mj.results.figures.panels import legend_below
from swarm_mj.results.figures.style import caption, new_figure, write
from swarm_mj.results.figures.view import tracer_of
from swarm_mj.results.look import BLACK
from swarm_mj.smallbody.shape import ShapeModel

#: What takes longest is begun first, so that nobody waits for it in the end.
SLOWEST = ("footprints", "illumination", "operation", "ground_track", "pointing_error")

Job = tuple[str, Any, Any, Any, bool]


def serve(workers: int) -> None:
    """Draw what is asked for until the input ends.

    Args:
        workers: Children that draw at once.
    """
    answers = os.dup(1)
    os.dup2(2, 1)  # what libraries print must not come between the answers
    warm_up()
    gc.freeze()  # what is there stays, and children need not look at it
    while True:
        try:
            kind, job = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        if kind == "draw":
            _share_out(job, workers, answers)
        else:
            _child(partial(_compile, job))


def _compile(plan: Any) -> None:
    with suppress(Exception):  # what fails here fails in the flight too, which says why
        compile_ahead(plan)


def warm_up() -> None:
    """Have loaded what the first figures would load: fonts, formulas, contours, the tracer of rays."""
    figure = new_figure(2.0, "title")
    left, right = figure.subplots(1, 2)
    left.set_yscale("log")
    left.set_ylim(1e-3, 1.0)
    caption(left, "$P_{TO}$")
    right.contour(np.eye(3), levels=[0.5])
    name_beside(right, np.zeros(2), "1", (1.0, 1.0), BLACK)
    legend_below(figure, [Line2D([], [], label="$x$")])
    with TemporaryDirectory() as folder:
        write(figure, Path(folder) / "figure.png", pdf=False)
    tracer_of(ShapeModel(np.eye(4, 3), np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]), "any"))


def _share_out(job: Job, workers: int, answers: int) -> None:
    names = sorted(composers(job[2]), key=lambda name: SLOWEST.index(name) if name in SLOWEST else len(SLOWEST))
    queue, end = os.pipe()
    os.write(end, bytes(range(len(names))))
    os.close(end)
    children = [_child(partial(_draw_from, queue, names, job, answers)) for _ in range(min(workers, len(names)))]
    os.close(queue)
    for child in children:
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if status:
            _answer(answers, None, None, f"a process that drew figures ended before its time ({status})")
    _answer(answers, None, None, "")


def _child(work: Callable[[], None]) -> int:
    """Fork a child that does some work and ends; gives its number."""
    child = os.fork()
    if child:
        return child
    try:
        work()
        os._exit(0)
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(1)


def _draw_from(queue: int, names: list[str], job: Job, answers: int) -> None:
    """Take numbers of figures from a queue and draw them until it is empty."""
    while number := os.read(queue, 1):
        _draw(names[number[0]], job, answers)


def _draw(name: str, job: Job, answers: int) -> None:
    folder, *flown, pdf = job
    try:
        draw(name, Path(folder), *flown, pdf=pdf)
    except Exception as error:
        _answer(answers, name, error, f"while {name}.png was drawn: {traceback.format_exc()}")
    else:
        _answer(answers, name, None, "")


def _answer(answers: int, name: str | None, error: Exception | None, words: str) -> None:
    """Write an answer in one piece, so that those of several children do not mix; a pipe takes so much at once."""
    try:
        line = b64encode(pickle.dumps((name, error, words[-1000:])))
        pickle.loads(pickle.dumps(error))
    except Exception:
        line = b""
    if not 0 < len(line) < select.PIPE_BUF:
        line = b64encode(pickle.dumps((name, None, words[-1000:])))
    os.write(answers, line + b"\n")
