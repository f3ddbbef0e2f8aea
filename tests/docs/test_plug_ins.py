"""The page of plug-ins describes every argument that a scenario can give to a built-in plug-in."""

from importlib.metadata import entry_points

import pytest

from swarm_mj import plugins

plug_ins = pytest.importorskip("scripts.site.plug_ins")

BUILT_IN = [
    entry
    for group in (plugins.CONTROLLERS, plugins.GRAVITY, plugins.BEHAVIORS)
    for entry in entry_points(group=group)
    if entry.value.startswith("swarm_mj.")
]


@pytest.mark.parametrize("entry", BUILT_IN, ids=lambda entry: entry.name)
def test_every_argument_of_a_built_in_plug_in_has_a_meaning(entry):
    for name, _, meaning in plug_ins.arguments(entry.load()):
        assert len(meaning) > 5, name


def test_the_page_has_them_all_with_their_defaults():
    page = plug_ins.page()
    assert len(BUILT_IN) >= 10
    for entry in BUILT_IN:
        assert f"### {entry.name}\n" in page
    assert "| `slope` | `0.4` | Rate commanded per unit of MRP near zero [rad/s]" in page
    assert "imaging_radius_m" not in page.split("## Behaviours")[1]
