"""Every named distribution has the moments and bounds that its formula says."""

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError
from scipy import stats

from swarm_mj.campaigns.distributions import Distribution

LAWS = {
    "uniform": ({"low": -2.0, "high": 4.0}, 1.0, 3.0),
    "log_uniform": ({"low": 1.0, "high": np.e}, np.e - 1.0, (np.e**2 - 1.0) / 2.0 - (np.e - 1.0) ** 2),
    "normal": ({"mean": 3.0, "std": 2.0}, 3.0, 4.0),
    "lognormal": ({"median": 2.0, "sigma": 0.5}, 2.0 * np.exp(0.125), 4.0 * np.exp(0.25) * (np.exp(0.25) - 1.0)),
    "triangular": ({"low": 0.0, "mode": 1.0, "high": 5.0}, 2.0, (25.0 + 1.0 - 5.0) / 18.0),
    "integer": ({"low": 1, "high": 6}, 3.5, 35.0 / 12.0),
    "bernoulli": ({"probability": 0.1}, 0.1, 0.09),
    "scipy": ({"name": "rayleigh", "parameters": {"scale": 2.0}}, 2.0 * np.sqrt(np.pi / 2), (4 - np.pi) / 2 * 4.0),
    "choice": ({"values": [1.0, 2.0, 10.0], "weights": [1, 2, 1]}, 3.75, 0.25 + 2.0 + 25.0 - 3.75**2),
}


def law(distribution, **values):
    return TypeAdapter(Distribution).validate_python({"distribution": distribution, **values})


@pytest.mark.parametrize("name", LAWS)
def test_moments_are_those_of_the_formula(name):
    values, mean, variance = LAWS[name]
    law_ = law(name, **values)
    n = 2_000
    drawn = np.array([law_.draw((k + 0.5) / n) for k in range(n)], float)
    assert drawn.mean() == pytest.approx(mean, rel=5e-3)
    assert drawn.var() == pytest.approx(variance, rel=3e-2)


def test_a_truncated_normal_keeps_its_bounds_and_its_shape_in_between():
    law_ = law("truncated_normal", mean=0.0, std=1.0, low=-1.0, high=2.0)
    drawn = np.array([law_.draw(u) for u in np.linspace(0, 1, 501)])
    assert drawn.min() >= -1.0 and drawn.max() <= 2.0
    inside = stats.norm.cdf(2.0) - stats.norm.cdf(-1.0)
    assert law_.draw((stats.norm.cdf(0.7) - stats.norm.cdf(-1.0)) / inside) == pytest.approx(0.7)


@pytest.mark.parametrize("name", LAWS)
def test_levels_are_as_many_as_is_said_before_they_are_made(name):
    law_ = law(name, **LAWS[name][0])
    assert law_.count == len(law_.levels())


@pytest.mark.parametrize("u", [0.0, 1.0])
def test_no_tail_becomes_infinite(u):
    assert np.isfinite(law("normal", mean=0.0, std=1.0).draw(u))
    assert np.isfinite(law("lognormal", median=1.0, sigma=3.0).draw(u))


def test_a_value_without_weight_is_never_chosen():
    law_ = law("choice", values=["a", "b", "c"], weights=[1, 1, 0])
    assert {law_.draw(u) for u in np.linspace(0, 1, 101)} == {"a", "b"}


def test_levels_of_a_grid():
    assert law("uniform", low=0.0, high=1.0, steps=3).levels() == [0.0, 0.5, 1.0]
    assert law("log_uniform", low=1.0, high=100.0, steps=3).levels() == pytest.approx([1.0, 10.0, 100.0])
    assert law("integer", low=2, high=4).levels() == [2, 3, 4]
    assert law("choice", values=["x", [1, 2]]).levels() == ["x", [1, 2]]
    assert law("normal", mean=0.0, std=1.0, steps=2).levels() == pytest.approx(stats.norm.ppf([0.25, 0.75]))


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("uniform", {"low": 1.0, "high": 1.0}),
        ("normal", {"mean": 0.0, "std": 0.0}),
        ("triangular", {"low": 0.0, "mode": 3.0, "high": 2.0}),
        ("choice", {"values": []}),
        ("choice", {"values": [1], "weights": [0]}),
        ("scipy", {"name": "os", "parameters": {}}),
        ("scipy", {"name": "rayleigh", "parameters": {"wrong": 1.0}}),
        ("scipy", {"name": "rayleigh", "parameters": {"scale": -1.0}}),
    ],
)
def test_impossible_parameters_are_refused(name, values):
    with pytest.raises(ValidationError):
        law(name, **values)
