"""rotorpy's batch of Hummingbirds under thrust and body rates, stepped at 50 Hz on the CPU.

PYTHON_WITH_ROTORPY -m benchmarks.peers.step_rotorpy ENVS ...

A step is 2 of its simulation at 100 Hz, its usual rate, with drag and with the quicker one of its
two integrators. It has no environment for a batch, so there are no observations, no reward and no
resets.
"""

import json
import sys
from importlib.metadata import version

import numpy as np
import torch
from rotorpy.vehicles.hummingbird_params import quad_params
from rotorpy.vehicles.multirotor import BatchedMultirotor, BatchedMultirotorParams

from benchmarks.peers import circle, steps

PERIOD = 0.01  # s, of its simulation
WEIGHT = quad_params["mass"] * 9.81  # N
CPU = torch.device("cpu")


class Batch:
    """Drones that hover."""

    def __init__(self, num_envs: int):
        hover = np.sqrt(WEIGHT / 4.0 / quad_params["k_eta"])
        start = {
            "x": np.zeros(3),
            "v": np.zeros(3),
            "q": np.array([0.0, 0.0, 0.0, 1.0]),
            "w": np.zeros(3),
            "wind": np.zeros(3),
            "rotor_speeds": np.full(4, hover),
        }
        self._state = {
            name: torch.from_numpy(np.tile(v, (num_envs, 1))) for name, v in start.items()
        }
        self._drones = BatchedMultirotor(
            BatchedMultirotorParams([quad_params] * num_envs, num_envs, CPU),
            num_envs,
            self._state,
            CPU,
            control_abstraction="cmd_ctbr",
            integrator="rk4",
        )
        self._every = np.arange(num_envs)

    def step(self, command: dict) -> None:
        """Makes a step with thrusts and body rates."""
        for _ in range(round(steps.STEP / PERIOD)):
            self._state = self._drones.step(self._state, command, PERIOD, self._every)


def main() -> None:
    """Prints the steps a second of every batch size, as JSON."""
    circle.on_one_core()
    torch.set_num_threads(1)
    rng, rates = np.random.default_rng(0), {}
    for num_envs in map(int, sys.argv[1:]):
        noise = rng.uniform(-0.1, 0.1, (16, num_envs, 4))
        commands = [
            {
                "cmd_thrust": torch.from_numpy(WEIGHT * (1.0 + each[:, :1])),
                "cmd_w": torch.from_numpy(each[:, 1:]),
            }
            for each in noise
        ]
        with torch.no_grad():
            rates[num_envs] = steps.timed(Batch(num_envs).step, commands, num_envs)
    print(json.dumps({"simulator": f"rotorpy {version('rotorpy')}", "rates": rates}))


if __name__ == "__main__":
    main()
