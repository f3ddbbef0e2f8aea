"""The page of scenario keys: every key has a meaning, every quantity a unit, and the tables say what the schema does."""

import pytest

from swarm_mj.campaigns.config import Base, Campaign
from swarm_mj.scenarios.keys import keys, section_of, sections, unit_of
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_faults import FAULT_KINDS

scenario_keys = pytest.importorskip("scripts.site.scenario_keys")

SECTIONS = [("", Scenario), *sections(Scenario), *FAULT_KINDS.items()]
KEYS = [(path, key) for path, section in SECTIONS for key in keys(section)]


def test_every_key_says_what_it_means():
    assert len(KEYS) > 190
    assert [f"{path}.{key.name}" for path, key in KEYS if len(key.meaning) < 5] == []


def test_every_quantity_has_a_unit():
    """A key that holds numbers ends in a unit, or its description holds one in brackets; [-] is one too."""
    quantities = [(path, key) for path, key in KEYS if key.type.startswith(("number", "2 ", "3 ", "list of numbers"))]
    assert len(quantities) > 100
    assert [f"{path}.{key.name}" for path, key in quantities if not key.unit] == []


def test_units_follow_the_names_of_the_keys():
    unit = unit_of
    assert unit("imaging_altitude_m", "") == "m" and unit("error_m_s", "") == "m/s" and unit("interval_s", "") == "s"
    assert unit("viscous_n_m_s", "") == "N m s/rad" and unit("spin_inertia_kg_m2", "") == "kg m²"
    assert unit("velocity", "inertial [m/s]") == "m/s" and unit("factor", "part that is left [-]") == "-"
    assert unit("fold", "every face must be seen by this many") == ""


@pytest.mark.parametrize(
    ("path", "name", "expected"),
    [
        ("camera", "half_angle_deg", ("number", "deg", "`21.5`", "> 0, < 90")),
        ("observation", "observer", ("word", "", "`auto`", "`auto`, `faceid`, `raster`, `raycast`, `horizon`")),
        ("design", "visiting_points", ("list of whole numbers", "", "`[7, 25, 31, 34, 38]`", "at least 1, at most 100,000")),
        ("spacecraft", "size_m", ("3 numbers", "m", "`[0.1, 0.1, 0.34]`", "≥ -1,000,000,000,000, ≤ 1,000,000,000,000")),
        ("wheel_lost", "wheel", ("whole number or word", "", "required", "`all`, `any`, ≥ 1, ≤ 4")),
        ("", "seed", ("whole number", "", "`0`", "≥ 0, < 2^63")),
    ],
)  # fmt: skip
def test_a_row_says_type_unit_default_and_what_is_allowed(path, name, expected):
    found = next(key for where, key in KEYS if (where, key.name) == (path, name))
    assert found[1:5] == expected


def test_every_key_of_the_schema_is_on_the_page():
    page = scenario_keys.page()
    for path, section in SECTIONS:
        heading = f"### {path}\n" if path in FAULT_KINDS else f"## {path or 'Top level'}\n"
        table = page.split(heading)[1].split("\n#")[0]
        for name, field in section.model_fields.items():
            inner = section_of(field.annotation)
            if name != "kind" and (inner is None or name == "faults"):
                assert f"| `{field.alias or name}` |" in table, f"{path}.{name}"


def test_every_key_of_a_campaign_file_says_what_it_means():
    for model in (Campaign, Base):
        for name, field in model.model_fields.items():
            assert field.description, name
