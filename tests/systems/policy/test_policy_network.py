"""The file of a network, and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airrace.common.errors import UserError
from airrace.systems.policy.gates_observation import observation_size
from airrace.systems.policy.policy_network import PolicyNetwork, load_policy
from airrace.vehicle import load_vehicle
from tests.worlds.linear_policy import linear_network

VEHICLE = load_vehicle("Default")[0]
SIZE = observation_size(2, 4)


def random_network(seed=0, sizes=(SIZE, 16, 16, 4)):
    rng = np.random.default_rng(seed)
    return PolicyNetwork(
        weights=tuple(rng.normal(0.0, 0.3, (n, m)) for m, n in zip(sizes, sizes[1:])),
        biases=tuple(rng.normal(0.0, 0.3, n) for n in sizes[1:]),
        mean=rng.normal(size=sizes[0]),
        scale=rng.uniform(0.5, 2.0, sizes[0]),
        low=np.full(sizes[0], -10.0),
        high=np.full(sizes[0], 10.0),
        gates=2,
        drone="Default",
        made_by="python examples/train_policy.py --seed 1",
    )


@given(seed=st.integers(0, 100))
@settings(max_examples=20)
def test_it_is_a_perceptron_with_tanh(seed):
    network = random_network(seed)
    x = observation = np.random.default_rng(seed).normal(0.0, 3.0, SIZE)
    x = (x - network.mean) / network.scale
    for W, b in zip(network.weights[:-1], network.biases[:-1]):
        x = np.tanh(W @ x + b)
    expected = np.clip(network.weights[-1] @ x + network.biases[-1], -1.0, 1.0)
    np.testing.assert_allclose(network.act(observation), expected, atol=1e-12)


def test_a_file_is_the_network_again(tmp_path):
    network = random_network()
    network.save(tmp_path / "policy.npz")
    loaded = load_policy(tmp_path / "policy.npz", VEHICLE)
    observation = np.linspace(-1.0, 1.0, SIZE)
    np.testing.assert_array_equal(loaded.act(observation), network.act(observation))
    assert loaded.made_by == network.made_by and loaded.gates == 2


def test_what_it_knows():
    network = random_network()
    assert network.is_known(np.full(SIZE, 10.0))
    assert network.is_known(np.full(SIZE, -10.9))  # by a twentieth of the range
    assert not network.is_known(np.append(np.zeros(SIZE - 1), 11.1))
    network = network._replace(low=np.full(SIZE, -np.inf))
    assert not network.is_known(np.append(np.zeros(SIZE - 1), 10.1))
    assert not network.is_known(np.append(np.zeros(SIZE - 1), np.nan))


def changed(**changes):
    return random_network()._replace(**changes)


@pytest.mark.parametrize(
    "network, words",
    [
        (changed(drone="StarOne"), "was trained on the drone StarOne, not on Default"),
        (changed(gates=3), "39 + 4"),
        (changed(gates=0), "gates is 0"),
        (random_network(sizes=(SIZE, 16, 5)), "its last layer has 5 outputs, not 4"),
        (changed(biases=random_network(sizes=(SIZE, 16, 15, 4)).biases), "biases_1 has 15"),
        (changed(mean=np.zeros(3)), "mean has 3 numbers"),
        (changed(scale=np.zeros(SIZE)), "scale must be positive"),
        (changed(low=np.full(SIZE, 11.0)), "low must not be above high"),
        (changed(high=np.full(SIZE, np.nan)), "low must not be above high"),
        (changed(mean=np.full(SIZE, np.inf)), "not all of its numbers are finite"),
        (changed(mean=np.zeros((SIZE, 1))), "mean has 2 dimensions"),
    ],
)
def test_a_network_that_cannot_fly(network, words, tmp_path):
    path = tmp_path / "policy.npz"
    network.save(path)
    if words == "39 + 4":
        words = "weights_0 is 16 x 43"
    with pytest.raises(UserError) as error:
        load_policy(path, VEHICLE)
    assert words in str(error.value) and str(path) in str(error.value)


def test_files_that_are_none(tmp_path):
    def refusal(path):
        with pytest.raises(UserError) as error:
            load_policy(path, VEHICLE)
        assert str(path) in str(error.value) and "\n" not in str(error.value)
        return str(error.value)

    assert "No such file" in refusal(tmp_path / "none.npz")
    assert "cannot be read" in refusal(tmp_path)
    (tmp_path / "text.npz").write_text("weights")
    refusal(tmp_path / "text.npz")
    (tmp_path / "empty.npz").write_bytes(b"")
    refusal(tmp_path / "empty.npz")
    np.savez(tmp_path / "other.npz", a=1)
    assert "it has no weights_0" in refusal(tmp_path / "other.npz")
    np.savez(tmp_path / "object.npz", weights_0=np.array([{}], object))
    refusal(tmp_path / "object.npz")
    random_network().save(tmp_path / "whole.npz")
    half = (tmp_path / "whole.npz").read_bytes()[:-100]
    (tmp_path / "half.npz").write_bytes(half)
    refusal(tmp_path / "half.npz")
    arrays = dict(np.load(tmp_path / "whole.npz"))
    del arrays["high"]
    np.savez(tmp_path / "part.npz", **arrays)
    assert "it has no high" in refusal(tmp_path / "part.npz")


def test_archives_that_are_broken_or_bombs(tmp_path):
    path = tmp_path / "p.npz"
    linear_network(VEHICLE).save(path)
    data = bytearray(path.read_bytes())
    data[60:110] = 50 * b"\xff"  # within what is compressed
    path.write_bytes(data)
    with pytest.raises(UserError, match="The policy .*p.npz cannot fly: .*; train one"):
        load_policy(path, VEHICLE)
    np.savez_compressed(path, weights_0=np.zeros(3_000_000))
    assert path.stat().st_size < 1_000_000
    with pytest.raises(UserError, match="it decompresses to more than"):
        load_policy(path, VEHICLE)


def test_a_linear_policy_hovers_in_the_middle_of_a_gate():
    network = linear_network(VEHICLE)
    observation = np.zeros(SIZE)
    observation[[3, 7, 11]] = 1.0  # level
    action = network.act(observation)
    np.testing.assert_allclose(action[1:], 0.0)
    assert action[0] * 17.0 + 17.0 == pytest.approx(9.81)
