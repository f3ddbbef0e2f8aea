"""Signals that come while compiled code keeps the main thread: hashing lets go of Python's lock and hears none."""

import signal
import subprocess
import sys

import pytest

SCRIPT = """
import hashlib, signal, sys, time
from pathlib import Path
from swarm_mj.cli import main as cli
from swarm_mj.io import interruption
from swarm_mj.io.atomic import atomic_folder

signal.signal(signal.SIGINT, signal.default_int_handler)  # those in the background of a script are born deaf to it
place = Path(sys.argv[1])
interruption.GRACE_S = 0.3

def deaf(rounds):
    print("begun", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", rounds)

def half_written():
    with atomic_folder(place / "new" / "run") as partial:
        (partial / "half.json").touch()
        deaf(2**31 - 1)

def kept_back():
    with interruption.held():
        deaf(ROUNDS)
        (place / "whole").touch()
    (place / "after").touch()

class Parser:
    def parse_args(self, argv):
        return self
    def command(self, arguments):
        globals()[sys.argv[2]]()

start = time.perf_counter()
hashlib.pbkdf2_hmac("sha256", b"", b"", 100_000)
ROUNDS = min(2**31 - 1, int(1.5e5 / (time.perf_counter() - start)))  # for more than a second, whatever the machine
cli._parser = Parser
sys.exit(cli.main())
"""


def interrupted(number, *arguments):
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "begun\n"
    process.send_signal(number)
    _, said = process.communicate(timeout=120)
    return process.returncode, said


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_program_that_compiled_code_keeps_is_ended_and_leaves_nothing_half_written(tmp_path, number):
    assert interrupted(number, tmp_path, "half_written") == (
        130, "\nswarm-mj: interrupted; nothing half-written was left behind\n",
    )  # fmt: skip
    assert not list(tmp_path.iterdir())


def test_what_belongs_together_is_done_before_a_kept_program_ends(tmp_path):
    status, said = interrupted(signal.SIGTERM, tmp_path, "kept_back")
    assert (status, said.count("interrupted")) == (130, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["whole"]
