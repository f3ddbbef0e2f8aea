"""Networks in array files: equations, files, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from swarm_mj.envs.policies.policy_network import WEIGHTS, NetworkPolicy, load_network, save_network

from swarm_mj.errors import ScenarioError


def random_policy(*, reads="swarm", readings=6, spacecraft=2, choices=4, **about):
    """Of a network of random weights."""
    rng = np.random.default_rng(0)
    logits = {"choice": 1, "spacecraft": choices, "swarm": spacecraft * choices}[reads]
    sizes = {"mean": (readings,), "scale": (readings,), "W1": (5, readings), "b1": (5,), "W2": (3, 5), "b2": (3,)}
    sizes |= {"W3": (logits, 3), "b3": (logits,)}
    weights = {name: rng.normal(size=shape).astype(np.float32).astype(np.float64) for name, shape in sizes.items()}
    weights["scale"] = np.float32(np.abs(weights["scale"]) + 0.5).astype(np.float64)
    return NetworkPolicy(weights, {"reads": reads, "spacecraft": spacecraft, "choices": choices, **about})


@pytest.mark.parametrize("reads", ["swarm", "spacecraft", "choice"])
def test_a_network_says_what_its_equations_say(reads):
    policy = random_policy(reads=reads)
    shapes = {"swarm": (3, 6), "spacecraft": (3, 2, 6), "choice": (3, 2, 4, 6)}
    shown = np.random.default_rng(1).normal(size=shapes[reads])
    w, logits = policy.weights, policy.logits(shown)
    assert logits.shape == (3, 2, 4)
    for e, j, c in np.ndindex(3, 2, 4):
        where, row = {"swarm": (e, 4 * j + c), "spacecraft": ((e, j), c), "choice": ((e, j, c), 0)}[reads]
        s = shown[where]
        x = [(s[i] - w["mean"][i]) / w["scale"][i] for i in range(6)]
        first = [np.tanh(sum(w["W1"][a, i] * x[i] for i in range(6)) + w["b1"][a]) for a in range(5)]
        hidden = [np.tanh(sum(w["W2"][b, a] * first[a] for a in range(5)) + w["b2"][b]) for b in range(3)]
        assert logits[e, j, c] == pytest.approx(sum(w["W3"][row, b] * hidden[b] for b in range(3)) + w["b3"][row])


def test_a_network_takes_the_best_of_the_choices_that_are_allowed():
    policy, shown = random_policy(), np.zeros((1, 6))
    best = policy.logits(shown)[0].argmax(axis=1)
    mask = np.ones((1, 2, 4), np.int8)
    assert policy.act(shown, mask)[0].tolist() == best.tolist()
    mask[0, 0, best[0]] = 0
    other = policy.act(shown, mask)[0]
    assert other[0] != best[0] and other[1] == best[1]


def test_a_network_acts_alike_alone_and_among_others():
    policy, shown = random_policy(), np.random.default_rng(2).normal(size=(64, 6))
    mask = np.ones((64, 2, 4), np.int8)
    alone = [policy.act(shown[e : e + 1], mask[:1])[0] for e in range(64)]
    assert np.array_equal(policy.act(shown, mask), alone)
    assert all(np.array_equal(policy.logits(shown[e : e + 1])[0], policy.logits(shown)[e]) for e in range(64))


def test_a_network_survives_its_file(tmp_path):
    policy = random_policy(environment="SwarmObserve-v0", layout=1, arguments={}, package="0.2.0")
    save_network(tmp_path / "policy.npz", policy)
    read = load_network(tmp_path / "policy.npz")
    assert read.about == {"format": 3, **policy.about}
    assert all(np.array_equal(read.weights[name], policy.weights[name]) for name in WEIGHTS)


def test_files_that_are_no_network_are_refused_by_name(tmp_path):
    file = tmp_path / "policy.npz"
    with pytest.raises(ScenarioError, match="policy.npz: cannot be read"):
        load_network(file)
    policy = random_policy()
    save_network(file, replace(policy, about={**policy.about, "choices": 5}))
    with pytest.raises(ScenarioError, match=r"b3 has the shape \(8,\), must have 10 entries"):
        load_network(file)
    save_network(file, replace(policy, weights=policy.weights | {"W2": np.zeros((3, 4))}))
    with pytest.raises(ScenarioError, match=r"W2 has the shape \(3, 4\)"):
        load_network(file)
    save_network(file, replace(policy, about={**policy.about, "format": 4}))
    with pytest.raises(ScenarioError, match="format"):
        load_network(file)
