"""crazyflow's Crazyflie on the circle, under crazyflow's Mellinger controller, on the CPU.

PYTHON_WITH_CRAZYFLOW -m benchmarks.peers.fly_crazyflow
"""

from importlib.metadata import version

import jax
import jax.numpy as jnp
import numpy as np
from crazyflow.control import Control
from crazyflow.sim import Sim
from crazyflow.sim.functional import state_control

from benchmarks.peers import circle


def main() -> None:
    """Flies with a command from Python at every tick, and as one compiled program."""
    circle.on_one_core()
    rows = []
    for fly, laps, besides in (
        (stepped, circle.LAPS, "commands from Python"),
        (compiled, 100, "all compiled, commands known beforehand"),
    ):
        sim = on_the_circle()
        rows.append(
            circle.timed(
                fly(sim),
                laps=laps,
                controller="Mellinger",
                besides=besides,
                position_hz=sim.control_freq,
                attitude_hz=sim.data.controls.attitude.freq,
                physics_hz=sim.freq,
                integrator=f"{sim.integrator}",
            )
        )
    circle.report(f"crazyflow {version('crazyflow')}", rows)


def on_the_circle() -> Sim:
    """Returns one drone with its state at the circle's start."""
    sim = Sim(control=Control.state)
    position, velocity = (jnp.array(row)[None, None] for row in circle.derivatives(0.0)[:2])
    states = sim.data.states
    sim.data = sim.data.replace(
        states=states.replace(
            pos=position.astype(states.pos.dtype), vel=velocity.astype(states.vel.dtype)
        )
    )
    return sim


def command(time: float) -> np.ndarray:
    """Returns the state to be in at a time (s), of one world and one drone, (1, 1, 16)."""
    return np.concatenate(
        [*circle.derivatives(time)[:3], [0.0, 0.0, 0.0, 1.0], np.zeros(3)]
    ).astype(np.float32)[None, None]


def stepped(sim: Sim):
    """Returns a flight as crazyflow's README has it, see circle.timed()."""
    steps, rate = sim.freq // sim.control_freq, sim.control_freq

    def fly(start, end):
        ticks = range(round(start * rate), round(end * rate))
        seen = []
        for tick in ticks:
            sim.state_control(command(tick / rate))
            sim.step(steps)
            seen.append(sim.data.states.pos)  # not waited for
        jax.block_until_ready(sim.data)
        return [(tick + 1) / rate for tick in ticks], np.array(seen)[:, 0, 0]

    return fly


def compiled(sim: Sim):
    """Returns a flight by the functional interface, in one call, see circle.timed()."""
    steps, rate = sim.freq // sim.control_freq, sim.control_freq
    step = sim._step  # what Sim.build_step_fn() returned

    def tick(data, target):
        data = step(state_control(data, target), n_steps=steps)
        return data, data.states.pos[0, 0]

    @jax.jit
    def laps(data, targets):
        return jax.lax.scan(tick, data, targets)

    def fly(start, end):
        times = np.arange(round(start * rate), round(end * rate)) / rate
        sim.data, seen = jax.block_until_ready(
            laps(sim.data, np.array([command(time) for time in times]))
        )
        return times + 1.0 / rate, np.array(seen)

    return fly


if __name__ == "__main__":
    main()
