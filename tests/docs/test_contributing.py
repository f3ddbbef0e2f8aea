"""CONTRIBUTING.md draws the map of the house as the layer test enforces it, and names what exists."""

import re
from pathlib import Path

from tests.test_layers import ORDER

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text("utf-8")


def test_the_map_lists_every_room_in_the_order_of_imports():
    rows = re.findall(r"^\| ([^|]+) \| [^|]+ \|$", PAGE.split("## Map of the house")[1].split("\n## ")[0], re.MULTILINE)
    listed = [re.findall(r"`(?:swarm_mj/)?(\w+)(?:\.py|/)`", row) for row in rows]
    order = [set(rooms) for rooms in ORDER if rooms != ("__main__",)]
    # Assets are a room of their own on the map, and belong to the first ones in the test.
    ours = [set(listed[1]) | set(listed[2]), *map(set, listed[3:])]
    assert ours == order


def test_paths_and_targets_that_it_names_exist():
    for path in re.findall(r"`((?:swarm_mj|tests|scripts|docs|assets|envs|examples|benchmarks)/[\w/.-]+)`", PAGE):
        assert (ROOT / path).exists(), path
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for line in re.findall(r"^make ([a-z -]+?)  ", PAGE, re.MULTILINE):
        assert set(line.split()) <= set(targets), line
