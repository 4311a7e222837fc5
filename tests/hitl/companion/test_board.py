"""board.sh, run here as it is run over ssh."""

import fcntl
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from airrace.common.patience import patient
from airrace.hitl.companion.set_up import board_command
from airrace.hitl.companion.ssh_errors import last_line


class Action(subprocess.Popen):
    """An action of board.sh, started in a session of its own, as by an ssh server."""

    def __init__(self, cache, *words):
        command, script = board_command(*words)
        super().__init__(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            env={**os.environ, "XDG_CACHE_HOME": str(cache.parent)},
            start_new_session=True,
        )
        self.stdin.write(script.decode())
        self.stdin.flush()

    def line(self):
        return self.stdout.readline().rstrip("\n")


@pytest.fixture
def cache(tmp_path):
    """airrace's folder on the companion, with an environment that has this Python."""
    cache = tmp_path / "airrace"
    (cache / "environments/e/bin").mkdir(parents=True)
    (cache / "environments/e/complete").touch()
    python = cache / "environments/e/bin/python"
    python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    python.chmod(0o755)
    (cache / "packages/p").mkdir(parents=True)
    (cache / "packages/p/complete").touch()
    (cache / "runs/r").mkdir(parents=True)
    return cache


def run(cache, source):
    """Starts the action that runs an autonomy of this source."""
    (cache / "runs/r/autonomy.py").write_text(source)
    (cache / "runs/r/command").write_text(f"exec {sys.executable} -u -S autonomy.py")
    return Action(cache, "run", cache / "runs/r", 0, sys.executable)


def test_autonomy_is_run_and_told_to_end(cache):
    with run(cache, "import time; print('one', flush=True); time.sleep(60)") as action:
        assert action.line().startswith("airrace-running: ")
        assert action.line() == "one"
        with Action(cache, "stop", cache / "runs/r", 0.5) as stop:
            assert stop.wait(patient(5.0)) == 0
        assert action.wait(patient(5.0)) == 128 + 15
        assert action.stdout.read() == ""


def test_autonomy_outlives_the_connection(cache):
    source = "import time\nfor i in range(20): print(i, flush=True); time.sleep(0.02)"
    with run(cache, source) as action:
        assert action.line().startswith("airrace-running: ")
        action.stdin.close()
        action.stdout.close()
        assert action.wait(patient(10.0)) == 0
        action.stdin = None
    assert (cache / "runs/r/output/autonomy.log").read_text().split() == list(map(str, range(20)))


def test_autonomy_of_a_lost_connection_can_be_stopped(cache):
    with run(cache, "import time; print('on', flush=True); time.sleep(60)") as first:
        pid = first.line().removeprefix("airrace-running: ")
        assert first.line() == "on"
        (cache / "runs/other").mkdir()
        with Action(cache, "run", cache / "runs/other", 0, sys.executable) as second:
            refused = second.line()
        assert second.returncode == 2
        assert refused.startswith("airrace-refused: Another race") and f"kill {pid}" in refused
        (cache / "runs/other/pid").write_text("1")
        for folder, ends in (("none", False), ("other", False), ("r", True)):
            with Action(cache, "stop", cache / "runs" / folder, 5) as stop:
                assert stop.wait(patient(10.0)) == 0
            if ends:
                assert first.wait(patient(5.0)) == 128 + 15
            assert (first.poll() is not None) == ends


def test_workers_that_are_left_behind_are_ended(cache):
    source = "import subprocess; print(subprocess.Popen(['sleep', '1000']).pid)"
    with run(cache, source) as action:
        assert action.line().startswith("airrace-running: ")
        group = int(action.line())
        assert action.wait(patient(5.0)) == 0
    assert not living(group)


def test_output_that_is_no_text(cache):
    source = "import os; os.write(1, b'\\xff\\xfe {host}\\r\\n' + b'x' * 100_000)"
    with run(cache, source) as action:
        assert action.line().startswith("airrace-running: ")
        assert action.line().endswith(" {host}")
        assert len(action.stdout.read()) == 100_000
    assert action.returncode == 0


@pytest.mark.parametrize(
    "damage, environment, package",
    [
        ([], True, True),
        (["environments/e/complete"], False, True),
        (["packages/p/complete"], True, False),
        (["environments/e/bin/python"], False, True),
    ],
)
def test_looks_for_what_is_there(cache, damage, environment, package):
    for name in damage:
        (cache / name).unlink()
    with Action(cache, "inspect", "e", "p") as action:
        lines = action.stdout.read().splitlines()
    assert action.returncode == 0 and f"airrace-cache: {cache}" in lines
    assert any(line.startswith("airrace-python: /") for line in lines)
    assert ("airrace-environment: there" in lines) == environment
    assert ("airrace-package: there" in lines) == package


def test_set_ups_wait_for_one_another_and_end_with_the_connection(cache):
    with open(cache / "set_up.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with Action(cache, "set_up", "e", "p", sys.executable, 0, "ONLINE") as action:
            assert "waiting" in action.line()
            action.stdin.close()
            assert action.wait(patient(5.0)) != 0
            action.stdin = None


def test_set_up_takes_its_programs_along(cache):
    (cache / "environments/e/complete").unlink()
    slow = cache / "slow"
    slow.write_text("#!/bin/sh\necho $$\nsleep 60\n")
    slow.chmod(0o755)
    with Action(cache, "set_up", "e", "p", slow, 0, "ONLINE") as action:
        assert action.line() == f"airrace-step: making an environment with {slow}"
        program = int(action.line())
        assert living(program)
        action.stdin.close()
        assert action.wait(patient(5.0)) != 0
        action.stdin = None
    wait_for(lambda: not living(program))


def living(pid):
    """Whether a process runs, and does not just wait to be reaped."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_for(condition, timeout=5.0):
    deadline = time.monotonic() + patient(timeout)
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_what_was_not_used_for_long_is_removed(cache):
    for name in ("environments/old", "packages/half"):
        (cache / name).mkdir()
    (cache / "environments/old/complete").touch()
    for path in (cache / "environments/old/complete", cache / "runs/r"):
        os.utime(path, (0, 0))
    with Action(cache, "set_up", "e", "p", sys.executable, 0, "ONLINE") as action:
        assert action.wait(patient(5.0)) == 0
    kept = [path.relative_to(cache).as_posix() for path in cache.glob("*/*") if path.is_dir()]
    assert sorted(kept) == ["environments/e", "packages/half", "packages/p"]


def test_last_line_is_the_error():
    output = "Collecting x\nERROR: no {wheel} for x.\n\nnotice: pip is old\n"
    assert last_line(output) == "no {wheel} for x"
    assert last_line("one\ntwo.\n") == "two"
    assert last_line("") == "it says nothing"
