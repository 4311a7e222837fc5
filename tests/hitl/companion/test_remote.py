"""What runs on the companion, here: its programs are started as over ssh."""

import fcntl
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from airrace.hitl.companion.deployment import _START, _TOOLS
from airrace.hitl.companion.remote import set_up


class Job(subprocess.Popen):
    """A job of airrace.hitl.companion.remote, started with nothing but the standard library."""

    def __init__(self, **job):
        super().__init__(
            [sys.executable, "-I", "-S", "-c", _START, str(_TOOLS.parent)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.stdin.write(json.dumps(job) + "\n")
        self.stdin.flush()

    def event(self):
        return json.loads(self.stdout.readline())


@pytest.fixture
def cache(tmp_path):
    """airrace's folder on the companion, with an environment that has this Python."""
    (tmp_path / "environments/e/bin").mkdir(parents=True)
    (tmp_path / "environments/e/complete").touch()
    python = tmp_path / "environments/e/bin/python"
    python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    python.chmod(0o755)
    (tmp_path / "packages/p/airrace/diagrams").mkdir(parents=True)
    (tmp_path / "packages/p/complete").touch()
    (tmp_path / "runs/r").mkdir(parents=True)
    return tmp_path


def run(cache, source, **more):
    """Starts the job that runs an autonomy of this source."""
    (cache / "packages/p/airrace/diagrams/hitl.py").write_text(source)
    return Job(
        do="run",
        cache=str(cache),
        environment="e",
        package="p",
        folder=str(cache / "runs/r"),
        udp_port=None,
        arguments=["-S", "-m", "airrace.diagrams.hitl"],
        **more,
    )


def test_autonomy_is_run_and_told_to_end(cache):
    with run(cache, "import time; print('one', flush=True); time.sleep(60)") as job:
        assert job.event() == {"event": "running"}
        assert job.event() == {"event": "log", "line": "one"}
        job.stdin.write("0.5\n")
        job.stdin.flush()
        assert job.event() == {"event": "exit", "code": -15}
        assert job.event() == {"event": "done"}


def test_autonomy_outlives_the_connection(cache):
    source = "import time\nfor i in range(20): print(i, flush=True); time.sleep(0.02)"
    with run(cache, source) as job:
        assert job.event() == {"event": "running"}
        job.stdin.close()
        job.stdout.close()
        assert job.wait(10.0) == 0
        job.stdin = None
    assert (cache / "runs/r/output/autonomy.log").read_text().split() == list(map(str, range(20)))


def test_autonomy_of_a_lost_connection_can_be_stopped(cache):
    with run(cache, "import time; print('on', flush=True); time.sleep(60)") as first:
        assert first.event() == {"event": "running"}
        assert first.event() == {"event": "log", "line": "on"}
        with run(cache, "") as second:
            refused = second.event()
        assert refused["event"] == "refused" and f"kill {first.pid}" in refused["sentence"]
        (cache / "runs/other").mkdir()
        (cache / "runs/other/pid").write_text("1")
        with Job(do="stop", cache=str(cache), folder=str(cache / "runs/other")) as job:
            assert job.event() == {"event": "done"}
        assert first.poll() is None  # that was another one's folder
        with Job(do="stop", cache=str(cache), folder=str(cache / "runs/r")) as job:
            assert job.event() == {"event": "done"}
        assert first.wait(5.0) == 0


def test_output_that_is_no_text(cache):
    source = "import os; os.write(1, b'\\xff\\xfe {host}\\r\\n' + b'x' * 100_000)"
    with run(cache, source) as job:
        assert job.event() == {"event": "running"}
        assert job.event()["line"].endswith(" {host}")
        assert len(job.event()["line"]) == 100_000
        assert job.event() == {"event": "exit", "code": 0}


@pytest.mark.parametrize(
    "damage, environment, package",
    [
        ([], False, False),
        (["environments/e/complete"], True, False),
        (["packages/p/complete"], False, True),
        (["environments/e/bin/python"], True, False),
    ],
)
def test_looks_for_what_is_missing(cache, damage, environment, package):
    for name in damage:
        (cache / name).unlink()
    with Job(do="look", cache=str(cache), environment="e", package="p") as job:
        assert job.event() == {"event": "missing", "environment": environment, "package": package}


def test_set_ups_wait_for_one_another_and_end_with_the_connection(cache):
    with open(cache / "set-up.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with Job(
            do="set-up", cache=str(cache), environment="e", package="p", room=0, offline=False
        ) as job:
            assert "waiting" in job.event()["text"]
            job.stdin.close()
            assert job.wait(5.0) == 1
            job.stdin = None


def test_set_up_takes_its_programs_along(tmp_path):
    source = (
        "import sys; sys.path.insert(0, sys.argv[1]); from remote.set_up import _run; "
        "from remote import set_up, events; "
        "events.in_background(set_up.die_with_the_connection); "
        "_run(['sh', '-c', 'echo $$ >' + sys.argv[2] + '; sleep 60'])"
    )
    with subprocess.Popen(
        [sys.executable, "-I", "-c", source, str(_TOOLS.parent), str(tmp_path / "pid")],
        stdin=subprocess.PIPE,
    ) as job:
        wait_for(lambda: (tmp_path / "pid").exists() and (tmp_path / "pid").read_text())
        group = int((tmp_path / "pid").read_text())
        job.stdin.close()
        assert job.wait(5.0) == 1
        job.stdin = None
    wait_for(lambda: not living(group))


def living(group):
    """Returns the processes of a group that are not just waiting to be buried."""
    stats = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            stats.append(path.read_text().rpartition(")")[2].split())
        except OSError:
            pass
    return [stat for stat in stats if int(stat[2]) == group and stat[0] != "Z"]


def wait_for(condition, timeout=5.0):
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_what_was_not_used_for_long_is_removed(cache):
    old = cache / "environments/old"
    old.mkdir()
    (old / "complete").touch()
    os.utime(old / "complete", (0, 0))
    (cache / "environments/half").mkdir()
    set_up._prune(cache / "environments")
    assert {path.name for path in (cache / "environments").iterdir()} == {"e", "half"}
    set_up._prune(cache / "none")


def test_last_line_is_the_error():
    output = "Collecting x\nERROR: no {wheel} for x.\n\nnotice: pip is old\n"
    assert set_up._last(output) == "no (wheel) for x"
    assert set_up._last("one\ntwo.\n") == "two"
    assert set_up._last("") == "it says nothing"
