"""How many steps a second the batch of drones makes, and batches of other simulators beside it.

    python -m benchmarks.envs [--envs 1 16 256 4096] [--drone NAME] [--level 0] [--peers]

A step is 20 ms of every drone, with observation, reward, and new episodes for those that end. The
drones hover in front of gates of student-airrace, by noisy actions of thrust and body rates;
the plant makes 20 steps at 1 kHz meanwhile, and the rate controller 10. On one core, and on all
that there are; each in a process of its own, the median of some blocks. --peers adds two others on
one core, if `python -m benchmarks.peers --install` has put them where that says: crazyflow's
environment, which makes 10 steps at 500 Hz with a simpler model; and rotorpy's batch of drones,
which makes 2 at 100 Hz, and has neither observation nor reward.
"""

import sys

import gymnasium
import numpy as np

from airrace.common.processes import processors
from airrace.envs import register_envs
from benchmarks import harness
from benchmarks.peers import circle, steps
from benchmarks.peers import environments as env

PHYSICS = 20  # steps of the plant in one of an environment
_PEERS = "crazyflow", "rotorpy"


def main(argv=None) -> int:
    """Measures and prints the table; exit code 1 if a peer that was asked for did not fly."""
    parser = harness.make_parser(__doc__)
    parser.add_argument(
        "--envs", type=harness.count, nargs="+", default=[1, 16, 256, 4096], help="batch sizes"
    )
    parser.add_argument("--drone", default="Default", help="a shipped drone, or a folder")
    parser.add_argument("--level", type=int, default=0, help="of difficulty, 0 to 3")
    parser.add_argument("--peers", action="store_true", help="crazyflow and rotorpy beside it")
    env.add_folder(parser)
    return harness.run(parser, argv, measure, show)


def measure(args) -> dict:
    """Steps all batches.

    Returns:
        ``rows``: a batch size each, with steps a second of ``one`` core, of ``all``, and of the
        ``peers`` that flew on one, by name; ``cores``; ``failures``: why the others did not.
    """
    cores = processors()
    jobs = [
        (_fly, (count, threads, args.drone, args.level))
        for count in args.envs
        for threads in dict.fromkeys((1, cores))
    ]
    rates = dict(zip((job[1][:2] for job in jobs), harness.in_processes(jobs, "Flying")))
    peers, failures = {}, []
    for name in _PEERS if args.peers else ():
        try:
            python = env.python_of(args.folder.absolute(), name, env.requirements()[name])
            peers[name] = env.fly(python, f"step_{name}", *args.envs)["rates"]
        except env.PeerError as e:
            failures.append(f"{name}: {e}")
    rows = [
        {
            "envs": count,
            "one": rates[count, 1],
            "all": rates[count, cores],
            "peers": {name: steps_of[str(count)] for name, steps_of in peers.items()},
        }
        for count in args.envs
    ]
    return {"rows": rows, "cores": cores, "failures": failures}


def show(results: dict) -> tuple[list, bool]:
    """Returns the table, and whether all flew that should."""
    columns = {
        "drones": "{envs}",
        "steps a second,\none core": "{one:,.0f}",
        "plant's steps,\none core": lambda row: f"{PHYSICS * row['one']:,.0f}",
        f"steps a second,\n{results['cores']} cores": "{all:,.0f}",
    }
    for name in results["rows"][0]["peers"]:
        columns[f"{name},\none core"] = f"{{peers[{name}]:,.0f}}"
        columns[f"airrace\nto {name}"] = lambda row, name=name: (
            f"{row['one'] / row['peers'][name]:.1f}"
        )
    table = harness.make_table(
        "Steps of 20 ms in a second, all drones together", results["rows"], columns
    )
    return [table, *results["failures"]], not results["failures"]


def _fly(count: int, threads: int, drone: str, level: int) -> float:
    """Returns the steps a second of a batch of drones, flown by some threads."""
    if threads == 1:
        circle.on_one_core()
    register_envs()
    batch = gymnasium.make_vec(
        "airrace/Race-v0",
        num_envs=count,
        drone=drone,
        level=level,
        start="random",
        num_threads=threads,
    )
    batch.reset(seed=0)
    noise = np.random.default_rng(0).uniform(-0.1, 0.1, (16, *batch.action_space.shape))
    actions = batch.unwrapped.hover_action + noise
    return steps.timed(batch.step, actions, count)


if __name__ == "__main__":
    sys.exit(main())
