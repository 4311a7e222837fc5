"""How many steps a second the batch of drones makes, and another simulator's environment beside it.

    python -m benchmarks.envs [--envs 1 16 256 4096] [--drone NAME] [--level 0] [--peers]

A step is 20 ms of every drone, with observation, reward, and new episodes for those that end. The
drones hover in front of gates of the reference track, by noisy actions of thrust and body rates;
the plant makes 20 steps at 1 kHz meanwhile, and the rate controller 10. On one core, and on all
that there are; each in a process of its own, the median of some blocks. --peers adds crazyflow's
environment on one core, if `python -m benchmarks.peers --install` has put it where that says. It
makes 10 steps at 500 Hz, with a simpler model.
"""

import os
import sys

import gymnasium
import numpy as np

from airrace.envs.registration import register_envs
from benchmarks import harness
from benchmarks.peers import circle, steps
from benchmarks.peers import environments as env

PHYSICS = 20  # steps of the plant in one of an environment
_PEER = "crazyflow"


def main(argv=None) -> int:
    """Measures and prints the table; exit code 1 if a peer that was asked for did not fly."""
    parser = harness.make_parser(__doc__)
    parser.add_argument(
        "--envs", type=harness.count, nargs="+", default=[1, 16, 256, 4096], help="batch sizes"
    )
    parser.add_argument("--drone", default="Default", help="a shipped drone, or a folder")
    parser.add_argument("--level", type=int, default=0, help="of difficulty, 0 to 3")
    parser.add_argument("--peers", action="store_true", help="crazyflow beside it")
    env.add_folder(parser)
    return harness.run(parser, argv, measure, show)


def measure(args) -> dict:
    """Steps all batches.

    Returns:
        ``rows``: a batch size each, with steps a second of ``one`` core, of ``all``, and of the
        ``peer`` on one, None without; ``cores``; ``failure``: why the peer did not fly, or None.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    jobs = [
        (_fly, (count, threads, args.drone, args.level))
        for count in args.envs
        for threads in dict.fromkeys((1, cores))
    ]
    rates = dict(zip((job[1][:2] for job in jobs), harness.in_processes(jobs, "Flying")))
    peer, failure = {}, None
    if args.peers:
        try:
            python = env.python_of(args.folder.absolute(), _PEER, env.requirements()[_PEER])
            peer = env.fly(python, f"step_{_PEER}", *args.envs)["rates"]
        except env.PeerError as e:
            failure = f"{_PEER}: {e}"
    rows = [
        {
            "envs": count,
            "one": rates[count, 1],
            "all": rates[count, cores],
            "peer": peer.get(str(count)),
        }
        for count in args.envs
    ]
    return {"rows": rows, "cores": cores, "failure": failure}


def show(results: dict) -> tuple[list, bool]:
    """Returns the table, and whether all flew that should."""
    columns = {
        "drones": "{envs}",
        "steps a second,\none core": "{one:,.0f}",
        "plant's steps,\none core": lambda row: f"{PHYSICS * row['one']:,.0f}",
        f"steps a second,\n{results['cores']} cores": "{all:,.0f}",
    }
    if any(row["peer"] for row in results["rows"]):
        columns[f"{_PEER},\none core"] = "{peer:,.0f}"
        columns["airrace,\ntimes"] = lambda row: f"{row['one'] / row['peer']:.1f}"
    table = harness.make_table(
        "Steps of 20 ms in a second, all drones together", results["rows"], columns
    )
    failure = results["failure"]
    return [table, *([failure] if failure else [])], not failure


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
