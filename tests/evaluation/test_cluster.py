"""The races are pretended, in this process; for real ones see tests/diagrams/test_evaluate.py."""

import collections
import dataclasses as dc
import gc
import socket
import threading

import pytest
from distributed import Client, LocalCluster

from airrace.common.errors import UserError
from airrace.evaluation import cluster
from airrace.evaluation.cluster import EvaluationStopped, check_workers, fly_races, running_cluster
from airrace.evaluation.versions import versions
from airrace.evaluation.worker import RaceKilled

FLOWN = collections.Counter()
STOPPED = threading.Event()


def pretend(job, evaluation):
    FLOWN[job.seed] += 1
    if FLOWN[job.seed] <= job.kills:
        raise RaceKilled("its process was killed (SIGKILL)")
    if job.long:
        STOPPED.wait(timeout=20)
        raise RaceKilled
    if job.refused:
        return {"seed": job.seed, "refused": "no such box."}
    return {"seed": job.seed}


def stop(evaluation):
    STOPPED.set()


@dc.dataclass
class Job:
    """A race that is pretended."""

    seed: int
    kills: int = 0
    refused: bool = False
    long: bool = False

    @property
    def key(self):
        return self.seed

    def describe(self):
        return f"race with seed {self.seed}"


@pytest.fixture
def client(monkeypatch):
    monkeypatch.setattr(cluster, "stop_races", stop)
    FLOWN.clear()
    STOPPED.clear()
    # What other tests left, such as a Meshcat, must not be destroyed in a thread of Dask's.
    gc.collect()
    with (
        LocalCluster(
            n_workers=1,
            threads_per_worker=2,
            processes=False,
            protocol="inproc",
            dashboard_address=None,
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
        ) as local,
        Client(local, set_as_default=False) as client,
    ):
        yield client


def test_killed_races_are_flown_again_and_none_counts_twice(client):
    rows = []
    fly_races(client, [Job(0), Job(1, kills=2), Job(2)], rows.append, pretend)
    assert sorted(row["seed"] for row in rows) == [0, 1, 2]
    assert FLOWN == {0: 1, 1: 3, 2: 1}


def test_what_is_killed_again_and_again_is_left_out_and_said(client):
    rows = []
    with pytest.raises(
        EvaluationStopped, match="1 races .* in 3 attempts, the race with seed 0: .*SIGKILL"
    ):
        fly_races(client, [Job(0, kills=99), *map(Job, range(1, 5))], rows.append, pretend)
    assert sorted(row["seed"] for row in rows) == [1, 2, 3, 4]
    assert FLOWN[0] == 3


def test_a_refused_race_ends_it(client):
    with pytest.raises(UserError, match="The race with seed 0 was refused: no such box"):
        fly_races(client, [Job(0, refused=True)], lambda row: pytest.fail("ended"), pretend)


def test_an_error_of_the_caller_ends_all_races(client):
    def full(row):
        raise UserError("the disk is full")

    with pytest.raises(UserError, match="the disk is full"):
        fly_races(client, [Job(0), Job(1, long=True)], full, pretend)
    assert STOPPED.is_set()  # the race in the air ends too


def test_workers_are_compared(client):
    expected = versions({})
    check_workers(client, expected, {})
    with pytest.raises(UserError, match="has drake .* instead of 1.0; give all workers the same"):
        check_workers(client, {**expected, "drake": "1.0"}, {})


def test_a_cluster_without_workers(monkeypatch):
    gc.collect()  # see client()
    monkeypatch.setattr(cluster, "_WORKERS_TIMEOUT", 0.2)
    with LocalCluster(
        n_workers=0,
        host="127.0.0.1",
        dashboard_address=None,
        scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
    ) as local:
        address = local.scheduler_address
        with pytest.raises(UserError, match=f"{address} has no workers; start some with 'dask"):
            with running_cluster(address):
                pytest.fail("connected")


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.0 400 Bad request\r\n" * 3, bytes(400)])
def test_what_listens_but_is_no_scheduler(monkeypatch, answer):
    """One that is silent, as a scheduler that was suspended, and two that talk otherwise."""
    monkeypatch.setattr(cluster, "_GREETING_TIMEOUT", 0.5)
    ends = []

    def serve():
        ends.append(server.accept()[0])
        ends[0].sendall(answer)

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=serve)
        thread.start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(UserError, match="something listens there, but it does not answer as"):
            with running_cluster(address):
                pytest.fail("connected")
        thread.join()
    ends[0].close()
