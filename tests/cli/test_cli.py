"""The command line as a whole: Ctrl-C at any moment, and what is said before anything is done."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time
import weakref

import pytest

from swarm_mj.cli import main as cli
from swarm_mj.cli.main import main
from swarm_mj.errors import OutputError
from swarm_mj.io import interruption
from swarm_mj.io.atomic import MARKER, Result, atomic_folder

QUICK = ["fly", "eros-quick", "--quiet", "--no-figures", "--no-report"]
SUMMARY = '{"scenario": "a", "versions": {"swarm_mj": "0"}}'
SAID = "\nswarm-mj: interrupted; nothing half-written was left behind\n"


@pytest.fixture(autouse=True)
def ctrl_c():
    """Ctrl-C as a terminal's programs hear it; those in the background of a script are born deaf to it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def command(monkeypatch):
    """Makes a function what every command does; the function runs in `main`, between its handlers."""

    def does(function):
        monkeypatch.setattr("swarm_mj.cli.names._available", lambda arguments: function(), raising=True)

    return does


class Falling:
    """Is interrupted while it is collected, where Python drops whatever is raised."""

    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(1000):  # the handler runs between two of these
            pass


def lose_an_interrupt():
    falling = Falling()
    del falling
    gc.collect()


def lose_an_interrupt_in_a_weakref():
    class Thing:
        pass

    thing = Thing()
    reference = weakref.ref(thing, lambda _: os.kill(os.getpid(), signal.SIGINT) or time.sleep(0.01))
    del thing
    assert reference() is None


LOSSES = [lose_an_interrupt, lose_an_interrupt_in_a_weakref]


@pytest.mark.parametrize("lose", LOSSES)
def test_an_interrupt_that_python_dropped_is_noticed_at_the_next_movement_of_a_bar(command, capsys, lose):
    from rich.console import Console

    from swarm_mj.io.progress import progress_bars

    reached = []

    def work():
        with progress_bars(Console(), quiet=True) as bars:
            task = bars.add_task("work", total=3)
            bars.update(task, completed=1)
            lose()
            reached.append("after the loss")
            bars.update(task, completed=2)
            reached.append("after the bar")

    command(work)
    assert main(["available"]) == 130
    assert reached == ["after the loss"]
    assert capsys.readouterr().err == SAID


@pytest.mark.parametrize("lose", LOSSES)
def test_an_interrupt_that_python_dropped_replaces_no_earlier_result(command, capsys, tmp_path, lose):
    run = tmp_path / "run"
    with atomic_folder(run, Result("run", "a")) as partial:
        (partial / MARKER).write_text(SUMMARY)
        (partial / "links.png").touch()

    def work():
        with atomic_folder(run, Result("run", "a")) as partial:
            (partial / MARKER).write_text(SUMMARY)
            lose()

    command(work)
    assert main(["available"]) == 130
    assert capsys.readouterr().err == SAID
    assert sorted(p.name for p in run.iterdir()) == ["links.png", MARKER]
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_an_interrupt_during_the_exchange_of_results_waits_until_all_is_in_its_place(
    command, capsys, tmp_path, monkeypatch
):
    run = tmp_path / "run"
    for _ in range(2):
        with atomic_folder(run, Result("run", "a")) as partial:
            (partial / MARKER).write_text(SUMMARY)
    (run / "my.mp4").write_text("a film")
    rename = type(run).rename

    def interrupted(path, target):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
        return rename(path, target)

    def work():
        with atomic_folder(run, Result("run", "a")) as partial:
            (partial / MARKER).write_text(SUMMARY)
            (partial / "target.png").touch()

    monkeypatch.setattr(type(run), "rename", interrupted)
    command(work)
    assert main(["available"]) == 130
    assert capsys.readouterr().err == SAID
    assert sorted(p.name for p in run.iterdir()) == ["my.mp4", MARKER, "target.png"]
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


@pytest.mark.parametrize(
    "error", [ValueError("Invalid bounding box"), OutputError("cannot"), ImportError("half"), MemoryError()]
)
def test_an_error_that_an_interruption_turned_into_is_reported_as_the_interruption(command, capsys, error):
    def work():
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(1)
        except KeyboardInterrupt:
            raise error from None

    command(work)
    assert main(["available"]) == 130
    assert capsys.readouterr().err == SAID


def test_an_error_that_nobody_asked_for_stays_what_it_is(command):
    def work():
        raise ValueError("Invalid bounding box")

    command(work)
    with pytest.raises(ValueError, match="bounding box"):
        main(["available"])


def test_a_command_that_takes_ctrl_c_as_its_end_has_ended_well(command):
    def view():
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(1)
        except KeyboardInterrupt:
            return 0

    command(view)
    assert main(["available"]) == 0


def test_the_handlers_are_those_of_before_when_a_command_has_ended(command, tmp_path):
    def handlers():
        return [signal.getsignal(number) for number in interruption.SIGNALS], sys.unraisablehook

    before, within = handlers(), []
    command(lambda: within.append(handlers()[0]))
    assert main(["available"]) == 0
    assert main([*QUICK, "--set", "camera=3", "--out", str(tmp_path / "run")]) == 2
    assert handlers() == before
    assert all(isinstance(handler, interruption.Interruption) for handler in within[0])


def test_a_signal_that_is_to_be_ignored_stays_ignored_and_other_threads_touch_none(command):
    seen = []
    command(lambda: seen.append(signal.getsignal(signal.SIGINT)))
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        assert main(["available"]) == 0
    finally:
        signal.signal(signal.SIGINT, before)
    thread = threading.Thread(target=main, args=(["available"],))
    thread.start()
    thread.join()
    assert seen == [signal.SIG_IGN, before]


def test_without_the_command_line_nothing_is_asked_and_nothing_held():
    interruption.check()
    with interruption.held():
        interruption.check()


INTERRUPTED_IMPORT = """
import builtins, os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from swarm_mj.cli import main as cli
plain = builtins.__import__
def interrupted(name, *rest):
    if name == sys.argv[1]:
        builtins.__import__ = plain
        os.kill(os.getpid(), signal.SIGINT)
    return plain(name, *rest)
builtins.__import__ = interrupted
sys.exit(cli.main(["available"]))
"""


@pytest.mark.parametrize("module", ["argparse", "swarm_mj.cli", "yaml"])
def test_ctrl_c_while_the_command_is_imported_is_one_line_too(module):
    done = subprocess.run([sys.executable, "-c", INTERRUPTED_IMPORT, module], capture_output=True, text=True)
    assert (done.returncode, done.stderr, done.stdout) == (130, SAID, "")


def test_a_second_scenarios_interruption_leaves_the_first_ones_result(tmp_path, monkeypatch):
    from swarm_mj.api import flight as runner

    simulate = runner.simulate
    (tmp_path / "second.yaml").write_text(
        "name: second\ndesign: {visiting_points: [3]}\nbehavior: {name: adaptable_roles}\n"
    )

    def interrupted(plan, progress):
        if plan.scenario.name == "second":
            os.kill(os.getpid(), signal.SIGINT)
        return simulate(plan, progress)

    monkeypatch.setattr(runner, "simulate", interrupted)
    both = ["fly", "eros-quick", str(tmp_path / "second.yaml"), *QUICK[2:], "--out", str(tmp_path / "multi")]
    assert main(both) == 130
    assert [p.name for p in (tmp_path / "multi").iterdir()] == ["eros-quick"]
    monkeypatch.setattr(runner, "make_plan", lambda scenario: os.kill(os.getpid(), signal.SIGINT) or time.sleep(1))
    assert main([*both[:-1], str(tmp_path / "new" / "multi")]) == 130
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("wrong", ["afile", "afile/run"])
def test_a_place_that_cannot_be_is_refused_without_an_empty_line(tmp_path, capsys, wrong):
    (tmp_path / "afile").touch()
    assert main(["fly", "eros-quick", "--out", str(tmp_path / wrong)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("swarm-mj: error:")


@pytest.mark.parametrize("command_line", [["fly", "eros-quick"], ["design", "eros-quick"]])
@pytest.mark.parametrize(
    ("key", "available"),
    [
        ("control.controller", "mrp_feedback, mrp_sliding_mode"),
        ("body.gravity.model", "point_mass, polyhedron, spherical_harmonics"),
        ("behavior.name", "adaptable_roles, body_tracking, dedicated_communications"),
    ],
)
def test_an_unknown_plug_in_is_told_with_its_key_before_anything_is_shown(
    tmp_path, capsys, command_line, key, available
):
    out = tmp_path / "deep" / "out"
    assert main([*command_line, "--set", f"{key}=nobody", "--out", str(out)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith(f"swarm-mj: error: {key} = 'nobody': unknown")
    assert f"available: {available}" in said.err
    assert list(tmp_path.iterdir()) == []


def test_a_summary_is_no_design_and_that_is_said_before_the_flight(tmp_path, capsys, monkeypatch):
    assert main([*QUICK, "--out", str(tmp_path / "run")]) == 0
    capsys.readouterr()
    monkeypatch.setattr("swarm_mj.api.flight.make_plan", lambda scenario: pytest.fail("was flown"))
    wrong = str(tmp_path / "run" / "summary.json")
    assert main([*QUICK, "--design", wrong, "--out", str(tmp_path / "again")]) == 2
    said = capsys.readouterr()
    assert "--design" in said.err and wrong in said.err
    assert "is no design.json of `swarm-mj design` (proof is missing" in said.err
    assert said.out == "" and not (tmp_path / "again").exists()


def test_one_observer_is_one():
    from swarm_mj.cli.tables import design_table

    record = {
        "proof": {"status": "optimal", "minimum": 1, "covered_percent": 100.0, "visiting_points": [3], "seconds": 0.1},
        "genetic": {}, "gap": 0, "n_observers": 1, "selected_by": "exact solver",
        "criterion": {"criterion": "arrival"}, "camera": {"half_angle_deg": 3.0},
    }  # fmt: skip
    record |= {"candidates": ["3"], "visiting_points": [3], "beyond_deployer": 0}
    assert "selected: 1 observer by" in design_table(record).caption and "Selected" not in design_table(record).caption
    record |= {
        "candidates": ["3 released at 60 s"],
        "beyond_deployer": 1,
        "delta_v_m_s": [4.5],
        "deployer_max_speed_m_s": 2.0,
    }
    assert (
        ". Selected: 3 released at 60 s. 1 of 1 leave at up to 4.5 m/s, beyond mothership."
        in design_table(record).caption
    )
    assert "selected: 2 observers by" in design_table({**record, "n_observers": 2}).caption


def test_the_parser_knows_every_command():
    assert "campaign" in cli._parser().format_help()


#: Loads NumPy only by way of the command; tells what its linear algebra was told when it was loaded.
WHEN_LOADED = """
import os, sys
from importlib.abc import MetaPathFinder
class Watch(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "numpy":
            print("threads:", os.environ.get("OPENBLAS_NUM_THREADS"))
from swarm_mj.cli.main import main
sys.meta_path.insert(0, Watch())
main(["available"])
"""


@pytest.mark.parametrize(("asked", "told"), [(None, "1"), ("3", "3")])
def test_linear_algebra_keeps_to_one_thread_unless_the_user_asks_for_more(asked, told):
    given = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    given |= {} if asked is None else {"OPENBLAS_NUM_THREADS": asked}
    done = subprocess.run([sys.executable, "-c", WHEN_LOADED], capture_output=True, text=True, env=given)
    assert f"threads: {told}\n" in done.stdout, done.stderr


#: Leaves behind what takes a minute to be collected, as machine code and arrays take seconds.
LITTERED = """
import sys, time
from swarm_mj.cli.main import main
class Litter:
    def __init__(self):
        self.itself = self
    def __del__(self, sleep=time.sleep):
        sleep(60.0)
litter = Litter()
sys.exit(main(sys.argv[1:]))
"""


def test_a_program_that_is_done_ends_without_a_search_for_garbage():
    done = subprocess.run([sys.executable, "-c", LITTERED, "--version"], capture_output=True, text=True, timeout=30)
    assert done.returncode == 0 and done.stdout.startswith("swarm-mj")
