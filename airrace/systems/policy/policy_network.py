"""The network of a policy, and its file."""

import struct
import zipfile
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from airrace.common.errors import UserError
from airrace.common.jit import compiled
from airrace.math.small_matrices import affine
from airrace.systems.policy.gates_observation import observation_size
from airrace.vehicle import Vehicle

ACTIONS = 4  # collective thrust and body rates, see command_scale.py
_MOST_BYTES = 20_000_000
# What NumPy and its archive raise for a file that is broken.
_BROKEN = (
    *(ArithmeticError, EOFError, LookupError, MemoryError, RuntimeError, TypeError, ValueError),
    *(struct.error, zipfile.BadZipFile, zlib.error),
)
_SLACK = 0.05  # of the range of the training: a hover that is quite level may be beyond it


class PolicyNetwork(NamedTuple):
    """A multilayer perceptron with tanh, from an observation ``gates`` to an action ``ctbr``."""

    weights: tuple[np.ndarray, ...]  #: of each layer, a tuple of (n_out, n_in)
    biases: tuple[np.ndarray, ...]  #: of each layer, a tuple of (n_out,)
    #: mean, scale: of the observation, so that the first layer sees (o - mean) / scale, (m,)
    mean: np.ndarray
    scale: np.ndarray
    #: low, high: least and greatest observations that it was trained on, (m,)
    low: np.ndarray
    high: np.ndarray
    gates: int  #: how many next gates it observes
    drone: str  #: name of the drone that it was trained on
    made_by: str = ""  #: command, commit and seed that made it

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Returns the action of an observation, (m,), each number from -1 to 1, (4,)."""
        x = (observation - self.mean) / self.scale
        last = len(self.weights) - 1
        for i, (W, b) in enumerate(zip(self.weights, self.biases)):
            x = _layer(W, b, x, i < last)
        return np.clip(x, -1.0, 1.0)

    def is_known(self, observation: np.ndarray) -> bool:
        """Whether an observation, (m,), is within what the network was trained on, or nearly."""
        size = self.high - self.low
        slack = np.where(np.isfinite(size), _SLACK * size, 0.0)
        return bool(
            np.all(observation >= self.low - slack) and np.all(observation <= self.high + slack)
        )

    def save(self, path: Path) -> None:
        """Writes the file that load_policy() reads: an .npz with an array for each attribute.

        Those of the layers are ``weights_0``, ``biases_0``, ``weights_1`` and so on.
        """
        arrays = self._asdict()
        for name in ("weights", "biases"):
            arrays |= {f"{name}_{i}": each for i, each in enumerate(arrays.pop(name))}
        np.savez_compressed(path, **arrays)


@compiled
def _layer(W, b, x, squash):
    """Returns W x + b, or its tanh, (n_out,)."""
    y = affine(W, x, b)
    return np.tanh(y) if squash else y


def load_policy(path: Path, vehicle: Vehicle) -> PolicyNetwork:
    """Loads the network of a drone, and checks all of it.

    Nothing in the file is run: it holds arrays only.

    Args: path: of the .npz file, see PolicyNetwork.save(). vehicle: that it is to fly.

    Raises:
        UserError: naming the file and what is wrong.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ValueError(f"it is larger than {_MOST_BYTES} bytes")
        with zipfile.ZipFile(path) as archive:
            if sum(each.file_size for each in archive.infolist()) > _MOST_BYTES:
                raise ValueError(f"it decompresses to more than {_MOST_BYTES} bytes")
        with np.load(path, allow_pickle=False) as file:
            network = _network(dict(file))
        _check(network, vehicle)
    except OSError as e:
        raise UserError(
            f"The policy {path} cannot be read ({e.strerror or e}); train one with "
            "examples/train_policy.py, or race with --policy none."
        ) from None
    except _BROKEN as e:
        raise UserError(
            f"The policy {path} cannot fly: {str(e).strip(chr(39))}; train one with "
            "examples/train_policy.py, or race with --policy none."
        ) from None
    return network


def _network(arrays: dict[str, np.ndarray]) -> PolicyNetwork:
    """Returns the network of a file's arrays."""
    layers = 0
    while f"weights_{layers}" in arrays:
        layers += 1
    if layers == 0:
        raise ValueError("it has no weights_0")
    names = [f"{kind}_{i}" for kind in ("weights", "biases") for i in range(layers)]
    for name in (*names, "mean", "scale", "low", "high", "gates", "drone"):
        if name not in arrays:
            raise ValueError(f"it has no {name}")
    return PolicyNetwork(
        weights=tuple(_floats(arrays, f"weights_{i}", 2) for i in range(layers)),
        biases=tuple(_floats(arrays, f"biases_{i}", 1) for i in range(layers)),
        **{name: _floats(arrays, name, 1) for name in ("mean", "scale", "low", "high")},
        gates=int(arrays["gates"]),
        drone=str(arrays["drone"]),
        made_by=str(arrays.get("made_by", "")),
    )


def _floats(arrays, name, dimensions):
    """Returns an array as float64 in C order."""
    result = np.ascontiguousarray(arrays[name], float)
    if result.ndim != dimensions:
        raise ValueError(f"{name} has {result.ndim} dimensions, not {dimensions}")
    return result


def _check(network: PolicyNetwork, vehicle: Vehicle) -> None:
    """Raises ValueError with a clause that says what is wrong with a network."""
    if network.drone != vehicle.name:
        raise ValueError(f"it was trained on the drone {network.drone}, not on {vehicle.name}")
    if not 1 <= network.gates <= 20:
        raise ValueError(f"gates is {network.gates}, not from 1 to 20")
    size = inputs = observation_size(network.gates, ACTIONS)
    for i, (W, b) in enumerate(zip(network.weights, network.biases)):
        if W.shape[1] != inputs or W.shape[0] != len(b):
            raise ValueError(
                f"weights_{i} is {W.shape[0]} x {W.shape[1]} and biases_{i} has {len(b)}, where "
                f"{inputs} numbers come in"
            )
        inputs = len(b)
    if inputs != ACTIONS:
        raise ValueError(f"its last layer has {inputs} outputs, not {ACTIONS}")
    for name in ("mean", "scale", "low", "high"):
        if len(getattr(network, name)) != size:
            raise ValueError(
                f"{name} has {len(getattr(network, name))} numbers; an observation of "
                f"{network.gates} gates has {size}"
            )
    finite = (*network.weights, *network.biases, network.mean, network.scale)
    if not all(np.isfinite(each).all() for each in finite):
        raise ValueError("not all of its numbers are finite")
    if np.isnan([network.low, network.high]).any() or np.any(network.low > network.high):
        raise ValueError("low must not be above high")
    if np.any(network.scale <= 0.0):
        raise ValueError("scale must be positive")
