"""Nothing that the program does at run time asks for a network."""

import json
import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.robust

#: Python reads this file at its start, in every process that a command starts.
GUARD = """
import sys

def refuse(event, arguments):
    if event in ("socket.getaddrinfo", "socket.gethostbyname", "socket.gethostbyaddr", "urllib.Request"):
        raise RuntimeError(f"network: {event} {arguments}")
    if event in ("socket.connect", "socket.sendto", "socket.bind") and isinstance(arguments[1], tuple):
        raise RuntimeError(f"network: {event} {arguments}")

sys.addaudithook(refuse)

# Two figures in the place of all.
from swarm_mj.io.atomic import FIGURES
FIGURES["run"], FIGURES["design"] = ("operation", "links"), ("cover",)
"""


@pytest.fixture
def offline(tmp_path):
    """An environment in which every Python process refuses to speak to the network."""
    (tmp_path / "guard").mkdir()
    (tmp_path / "guard" / "sitecustomize.py").write_text(GUARD)
    path = os.pathsep.join(filter(None, (str(tmp_path / "guard"), os.environ.get("PYTHONPATH"))))
    return {**os.environ, "PYTHONPATH": path}


def run(arguments, environment, folder):
    return subprocess.run(
        [sys.executable, *arguments], env=environment, cwd=folder, capture_output=True, text=True, timeout=600
    )


@pytest.mark.parametrize(
    "code",
    [
        "import socket; socket.create_connection(('127.0.0.1', 9))",
        "import socket; socket.getaddrinfo('example.org', 80)",
        "import urllib.request; urllib.request.urlopen('http://127.0.0.1')",
        "import multiprocessing as m, socket\nif __name__ == '__main__':\n"
        "    with m.get_context('spawn').Pool(1) as p: p.apply(socket.create_connection, (('127.0.0.1', 9),))",
    ],
)
def test_the_guard_refuses_the_network_in_this_process_and_its_children(offline, tmp_path, code):
    (tmp_path / "script.py").write_text(code)
    done = run(["script.py"], offline, tmp_path)
    assert done.returncode != 0
    assert "RuntimeError: network" in done.stderr


#: In one process, which loads once what it needs. The design has a cache of its own, so that its pictures are judged here, by
#: worker processes, as the figures are drawn by others.
WORK = """
import gymnasium
from swarm_mj.cli.main import main

if __name__ == "__main__":
    quick = ["eros-quick", "--quiet"]
    assert main(["fly", *quick, "--out", "run"]) == 0
    short = ["--workers", "2", "--set", "designer.max_generations=5"]
    assert main(["design", *quick, *short, "--out", "found"]) == 0
    assert main(["fly", *quick, "--no-figures", "--design", "found/design.json", "--out", "flown"]) == 0
    env = gymnasium.make("swarm_mj.envs:SwarmObserve-v0", missions=["ellipsoid-train-1"])
    env.reset(seed=0)
    env.step(env.action_space.sample())
    print("all done")
"""


def test_a_flight_its_figures_a_design_and_an_episode_need_no_network(offline, tmp_path):
    (tmp_path / "work.py").write_text(WORK)
    done = run(["work.py"], {**offline, "SWARM_MJ_CACHE": str(tmp_path / "cache")}, tmp_path)
    assert done.returncode == 0 and done.stdout.endswith("all done\n"), done.stderr
    assert (tmp_path / "run" / "operation.png").stat().st_size > 1000
    found = json.loads((tmp_path / "found" / "design.json").read_text())
    assert json.loads((tmp_path / "flown" / "summary.json").read_text())["observers"] == found["n_observers"]
