"""The page of plug-ins describes every argument that a scenario can give to a built-in plug-in."""

import pytest

from swarm_mj.scenarios.catalogue import GROUPS, arguments, installed

plug_ins = pytest.importorskip("scripts.site.plug_ins")

BUILT_IN = [(place, e) for group, place in GROUPS.items() for e in installed(group) if e.value.startswith("swarm_mj.")]


@pytest.mark.parametrize(("place", "entry"), BUILT_IN, ids=lambda given: getattr(given, "name", ""))
def test_every_argument_of_a_built_in_plug_in_has_a_meaning(place, entry):
    for argument in arguments(entry.load(), place.given):
        assert len(argument.meaning) > 5, argument.name


def test_the_page_has_them_all_with_their_defaults():
    page = plug_ins.page()
    assert len(BUILT_IN) >= 10
    for _, entry in BUILT_IN:
        assert f"### {entry.name}\n" in page
    assert "| `slope` | `0.4` | Rate commanded per unit of MRP near zero [rad/s]" in page
    assert "imaging_radius_m" not in page.split("## Behaviours")[1]
