"""Hands races to the workers of a Dask cluster, and gets their rows back."""

import contextlib
import functools
import logging
import pickle
import re
import signal
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError

import dask
from distributed import Client, LocalCluster, WorkerPlugin, as_completed

from airrace.common.errors import UserError
from airrace.evaluation.versions import mismatch, versions
from airrace.evaluation.worker import RaceJob, fly, stop_races

_ATTEMPTS = 3  # at a race whose worker or process is killed
_LOCAL = {
    # A race whose worker is killed is flown again.
    "distributed.scheduler.allowed-failures": 10,
    # Races are long: none waits behind another while a worker is idle.
    "distributed.scheduler.worker-saturation": 1.0,
    # Nobody watches, so nothing but what the races need listens.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
_CONNECT_TIMEOUT = 10  # s
_WORKERS_TIMEOUT = 20  # s
_STOP_TIMEOUT = 5  # s


class EvaluationStopped(Exception):
    """The evaluation ended before all its races; the message is a clause that says why."""


class _IgnoreInterrupts(WorkerPlugin):
    """Keeps Ctrl-C in a terminal, which reaches all its processes, from the workers."""

    def setup(self, worker):
        signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextlib.contextmanager
def local_cluster(workers: int) -> Iterator[Client]:
    """Starts worker processes on this machine, reachable from it alone, and yields a client."""
    with (
        dask.config.set(_LOCAL),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            memory_limit=0,  # a worker is small: its races are other processes
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
            scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        client.register_plugin(_IgnoreInterrupts())
        yield client


@contextlib.contextmanager
def running_cluster(address: str) -> Iterator[Client]:
    """Connects to a scheduler, and yields a client.

    Raises:
        UserError: if it cannot be reached or has no workers.
    """
    if not re.fullmatch(r"(tcp|tls)://[^/\s]+:\d{1,5}", address):
        raise UserError(f"--scheduler must be tcp://HOST:PORT, not '{address}'.")
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # said by the errors
    try:
        client = Client(address, timeout=_CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as e:
        raise UserError(
            f"--scheduler {address} cannot be reached ({_words(e)}); start one with "
            "'dask scheduler' and give its address as tcp://HOST:PORT."
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=_WORKERS_TIMEOUT)
        except TimeoutError:
            raise UserError(
                f"--scheduler {address} has no workers; start some with "
                f"'dask worker {address} --nthreads 1'."
            ) from None
        yield client


def check_workers(client: Client, expected: dict, systems: dict) -> None:
    """Raises UserError if a worker has another airrace or other libraries.

    Args:
        client: of the cluster.
        expected: versions() of this process.
        systems: of the scenario.
    """
    for worker, actual in client.run(versions, systems, on_error="return").items():
        if isinstance(actual, BaseException):
            clause = f"cannot import airrace ({_words(actual)})"
        else:
            differs = mismatch(expected, actual)
            clause = differs and f"has {differs}"
        if clause:
            raise UserError(
                f"The worker {worker} {clause}; give all workers the same files and "
                "packages, and start them again."
            )


def fly_races(client: Client, jobs: list[RaceJob], ended: Callable[[dict], None]) -> None:
    """Flies races, each on whatever worker is free.

    A race is flown again when its worker is killed. When this ends early,
    the races that are still in the air are ended too.

    Args:
        client: of the cluster.
        jobs: the races.
        ended: called once for every race with its row; see fly().

    Raises:
        UserError: if a worker refuses a race.
        EvaluationStopped: if the scheduler is lost, or races were killed time
            and again; all others have ended then.
    """
    evaluation = uuid.uuid4().hex
    call = _make_call()

    def submit(job, attempt):
        race = pickle.dumps(functools.partial(fly, job, evaluation))
        return client.submit(call, race, key=f"race-{evaluation}-{job.seed}-{attempt}", pure=False)

    futures = {submit(job, 1): (job, 1) for job in jobs}
    lost = {}  # seed to reason
    try:
        completed = as_completed(list(futures), loop=client.loop)
        for future in completed:
            job, attempt = futures.pop(future)
            row = _row(client, future)
            if not isinstance(row, Exception):
                ended(row)
            elif attempt < _ATTEMPTS:
                again = submit(job, attempt + 1)
                futures[again] = job, attempt + 1
                completed.add(again)
            else:
                lost[job.seed] = _words(row)
    except BaseException:
        _stop(client, futures, evaluation)
        raise
    if lost:
        seed, reason = min(lost.items())
        raise EvaluationStopped(
            f"{len(lost)} races could not be flown in {_ATTEMPTS} attempts, with seed {seed}: "
            f"{reason}"
        )


def _make_call() -> Callable:
    """Returns a function that calls what was pickled.

    It is local, so it travels by value: a scheduler, which unpickles tasks but
    not what this one is given, needs no airrace.
    """

    def call(pickled):
        import pickle

        return pickle.loads(pickled)()

    return call


def _row(client: Client, future) -> dict | Exception:
    """Returns the row of a race that has ended, or what befell its worker instead."""
    try:
        row = future.result()
    except CancelledError:
        raise EvaluationStopped("the scheduler was lost") from None
    except Exception as e:
        if client.status != "running":
            raise EvaluationStopped("the scheduler was lost") from None
        return e
    if "refused" in row:
        raise UserError(f"The race with seed {row['seed']} was refused: {row['refused']}")
    return row


def _stop(client: Client, futures, evaluation):
    with contextlib.suppress(Exception):
        if client.status == "running":
            client.cancel(list(futures), force=True)
            stop = functools.partial(
                client.run, stop_races, evaluation, on_error="ignore", asynchronous=True
            )
            client.sync(stop, callback_timeout=_STOP_TIMEOUT)


def _words(error: BaseException) -> str:
    """Returns what an error says, on one line and without a full stop."""
    return (" ".join(str(error).split()) or type(error).__name__).rstrip(".")[:300]
