"""Hands races to the workers of a Dask cluster, and gets their rows back."""

import asyncio
import contextlib
import functools
import logging
import pickle
import re
import uuid
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from typing import Any, Protocol

import dask
from distributed import Client, Future, LocalCluster, Security, as_completed
from distributed.comm import connect

from airrace.common.errors import UserError, words
from airrace.common.interrupts import interrupts_held
from airrace.common.processes import processors
from airrace.evaluation.store import RaceStore
from airrace.evaluation.versions import mismatch, versions
from airrace.evaluation.worker import fly, stop_races

_ATTEMPTS = 3  # at a race whose worker or process is killed
_LOCAL = {
    # A race whose worker is killed is flown again.
    "distributed.scheduler.allowed-failures": 10,
    # Races are long: none waits behind another while a worker is idle.
    "distributed.scheduler.worker-saturation": 1.0,
    # Nobody watches, so nothing but what the races need listens.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    # Nor does it watch itself: that takes six hundredths of a core from races, in each process.
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}
_CONNECT_TIMEOUT = 10  # s
_GREETING_TIMEOUT = 15  # s, with connecting
_WORKERS_TIMEOUT = 20  # s
_STOP_TIMEOUT = 5  # s


class EvaluationStopped(Exception):
    """The evaluation ended before all its races; the message is a clause that says why."""


@contextlib.contextmanager
def local_cluster(workers: int) -> Iterator[Client]:
    """Starts workers in this process, which nobody else can reach, and yields a client.

    A worker only waits for a race, which is a process of its own.
    """
    with (
        dask.config.set(_LOCAL),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=False,
            memory_limit=0,
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
            scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield client


@contextlib.contextmanager
def running_cluster(address: str) -> Iterator[Client]:
    """Connects to a scheduler, and yields a client.

    Raises UserError if it cannot be reached, is no scheduler, or has no workers.
    """
    if not re.fullmatch(r"(tcp|tls)://[^/\s]+:\d{1,5}", address):
        raise UserError(f"--scheduler must be tcp://HOST:PORT, not '{address}'.")
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # said by the errors
    try:
        with ThreadPoolExecutor(1) as thread:  # here, in a notebook, a loop may be running
            thread.submit(asyncio.run, _greet(address)).result()
        client = Client(address, timeout=_CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, TypeError, ValueError) as e:
        raise UserError(
            f"--scheduler {address} cannot be reached ({words(e)}); start one with "
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


async def _greet(address: str) -> None:
    """Raises UserError if what listens at an address is no scheduler, OSError if nothing does.

    TypeError without the keys that tls:// takes.

    A Client has no limit for this: it would wait for an answer without an end.
    """
    security = Security().get_connection_args("client")
    greeting = connect(address, timeout=_CONNECT_TIMEOUT, **security)
    try:
        comm = await asyncio.wait_for(greeting, _GREETING_TIMEOUT)
    except Exception as e:  # whatever reading another program's answer as Dask's may raise
        if isinstance(e, (OSError, TypeError)) and not isinstance(e, TimeoutError):
            raise
        raise UserError(
            f"--scheduler {address}: something listens there, but it does not answer as a Dask "
            "scheduler; start one with 'dask scheduler', and give the address that it says."
        ) from None
    await comm.close()


def fly_missing(
    jobs: "Sequence[Job]",
    store: RaceStore,
    options: tuple[int | None, str | None],
    show: Callable[[dict], object],
    *,
    systems: dict,
    keep: Callable[[dict], dict] = lambda row: row,
    fly: Callable[[Any, str], dict] = fly,
    live: contextlib.AbstractContextManager = contextlib.nullcontext(),
) -> str | None:
    """Flies the races that a store lacks; returns why they were ended early, or None.

    Args:
        options: --workers (by default, one a processor) and --scheduler (None: on this computer).
        show: called with the row of each race that has ended.
        systems: of the scenario.
        keep: from a row to what of it is stored.
        fly: see fly_races().
        live: the block in which they fly.

    Raises:
        UserError: if there is no cluster, a worker has other versions, or a file cannot be written.
    """
    workers, scheduler = options

    def ended(row):
        with interrupts_held():
            kept = keep(row)
            store.append(kept)
        show(kept)

    missing = [job for job in jobs if job.key not in store.keys]
    if not missing:
        return None
    if scheduler is not None:
        connection = running_cluster(scheduler)
    else:
        connection = local_cluster(workers or processors())
    try:
        with connection as client:
            check_workers(client, missing[0].versions, systems)
            with live:
                fly_races(client, missing, ended, fly)
    except KeyboardInterrupt:
        return "interrupted"
    except EvaluationStopped as e:
        return str(e)
    return None


def check_workers(client: Client, expected: dict, systems: dict) -> None:
    """Raises UserError if a worker has another airrace or other libraries.

    Args: expected: versions() of this process.
    """
    for worker, actual in client.run(versions, systems, on_error="return").items():
        if isinstance(actual, BaseException):
            clause = f"cannot import airrace ({words(actual)})"
        else:
            differs = mismatch(expected, actual)
            clause = differs and f"has {differs}"
        if clause:
            raise UserError(
                f"The worker {worker} {clause}; give all workers the same files and "
                "packages, and start them again."
            )


class Job(Protocol):
    """A race that can be flown."""

    @property
    def key(self) -> int | str:
        """What tells it from the others; its row has the key."""

    @property
    def versions(self) -> dict:
        """Those that it is to be flown with."""

    def describe(self) -> str:
        """Returns what it is called in a sentence."""


def fly_races(
    client: Client,
    jobs: Sequence[Job],
    ended: Callable[[dict], None],
    fly: Callable[[Any, str], dict] = fly,
) -> None:
    """Flies races, each on whatever worker is free.

    A race is flown again when its process or its worker is killed. When this ends early,
    the races that are still in the air are ended too.

    Args:
        ended: called once for every race with its row; see fly().
        fly: a function that flies one: worker.fly(), or another with its arguments.

    Raises:
        UserError: if a worker refuses a race.
        EvaluationStopped: if the scheduler is lost, or races were killed time
            and again; all others have ended then.
    """
    evaluation = uuid.uuid4().hex
    futures = {
        client.submit(
            # A local function travels by value, and a race as bytes: a scheduler, which unpickles
            # tasks but not their arguments, needs no airrace.
            lambda race: pickle.loads(race)(),
            pickle.dumps(functools.partial(fly, job, evaluation)),
            key=f"race-{evaluation}-{job.key}",
            retries=_ATTEMPTS - 1,
        ): job
        for job in jobs
    }
    lost = []  # pairs of a job's description and the reason
    try:
        for future in as_completed(list(futures), loop=client.loop):
            job = futures[future]
            try:
                row = future.result()
            except (Exception, CancelledError) as e:
                if isinstance(e, CancelledError) or client.status != "running":
                    raise EvaluationStopped("the scheduler was lost") from None
                lost.append((job.describe(), words(e)))
                continue
            if "refused" in row:
                raise UserError(f"The {job.describe()} was refused: {row['refused']}")
            ended(row)
    except BaseException:
        _stop(client, futures, evaluation)
        raise
    if lost:
        name, reason = min(lost)
        raise EvaluationStopped(
            f"{len(lost)} races could not be flown in {_ATTEMPTS} attempts, the {name}: {reason}"
        )


def _stop(client: Client, futures: Iterable[Future], evaluation: str) -> None:
    with contextlib.suppress(Exception):
        if client.status == "running":
            client.cancel(list(futures), force=True)
            stop = functools.partial(
                client.run, stop_races, evaluation, on_error="ignore", asynchronous=True
            )
            client.sync(stop, callback_timeout=_STOP_TIMEOUT)
