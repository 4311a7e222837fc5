"""airrace races wherever it is put, and whoever starts it: a row for each kind of place.

What other systems lack is hidden from it here: docs/install.md says what only they can prove.
"""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = sysconfig.get_path("purelib")
SHORT = "{referee: {time_limit: 1.0}}"  # the race runs out of time on the pad
RACE = ["-P", "-m", "airrace", "race", "--scenario_text", SHORT]
RACE += ["--no-meshcat", "--no-report", "--record", "none", "--output"]
NOBODY = 65534

pytestmark = pytest.mark.slow


def has(*programs):
    return all(map(shutil.which, programs))


@pytest.fixture
def copy(tmp_path):
    """A function that copies what is installed into a folder of a given name."""

    def put(name):
        place = tmp_path / name
        for part in ("airrace", "models"):  # and the machine code
            shutil.copytree(ROOT / part, place / part)
        return place

    return put


def environment(place, **more):
    """An environment in which airrace is that of a place, and nobody has a home."""
    return {"PATH": os.environ["PATH"], "PYTHONPATH": f"{place}:{PACKAGES}", **more}


def run(command, folder, env):
    done = subprocess.run(
        [str(word) for word in command], cwd=folder, env=env, capture_output=True, text=True
    )
    assert done.returncode == 1, done.stderr[-2000:]  # it did not finish, as it should
    assert "Results: " in done.stdout, done.stderr[-2000:]
    return done


def check_result(folder):
    assert json.loads((folder / "race.json").read_text(encoding="utf-8"))["dnf_reason"]


@pytest.mark.parametrize(
    "name",
    [
        "my races ñ 無人機 #1 'quoted' $HOME;",
        pytest.param("plain", marks=pytest.mark.repeats),
        pytest.param("-looks like an option", marks=pytest.mark.repeats),
        pytest.param("a" * 200, marks=pytest.mark.repeats),
        pytest.param("percent %s {brace} \\back", marks=pytest.mark.repeats),
    ],
)
def test_folders_of_any_name_and_no_home(copy, name):
    """The package, the working folder and the results are in it."""
    place = copy(name)
    done = run([sys.executable, *RACE, f"./{name} 2"], place, environment(place))
    check_result(place / f"{name} 2")
    assert "Compiling" not in done.stderr  # a copy takes its machine code along


@pytest.mark.repeats
@pytest.mark.parametrize("home", ["/nowhere/at/all", "/dev/null", ""])
def test_a_home_that_is_none(copy, home):
    place = copy("place")
    run([sys.executable, *RACE, "out"], place, environment(place, HOME=home))
    check_result(place / "out")


@pytest.mark.skipif(
    os.name != "posix" or os.getuid() != 0 or not has("bwrap", "setpriv"),
    reason="only root can be somebody else",
)
def test_an_installation_of_another_user_that_nobody_may_write_to(copy):
    """As in a container: without a home and a network, and only /tmp is writable."""
    place = copy("place")
    inside = {str(place): "/tmp/place", sys.base_prefix: "/tmp/python", PACKAGES: "/tmp/packages"}
    binds = [word for pair in inside.items() for word in ("--ro-bind", *pair)]
    sandbox = ["bwrap", "--ro-bind", "/", "/", "--dev", "/dev", "--proc", "/proc"]
    sandbox += ["--perms", "1777", "--tmpfs", "/tmp", *binds, "--unshare-net"]
    sandbox += ["--cap-add", "CAP_SETUID", "--cap-add", "CAP_SETGID", "--chdir", "/tmp", "--"]
    user = ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"]
    env = environment("/tmp/place", LD_LIBRARY_PATH="/tmp/python/lib")
    env["PYTHONPATH"] = "/tmp/place:/tmp/packages"
    python = f"/tmp/python/bin/{Path(os.path.realpath(sys.executable)).name}"
    race = [python, *RACE, "/tmp/out"]
    script = (
        '"$@"; code=$?; cat /tmp/out/race.json >&2; find /tmp/place -newer /tmp/out; exit $code'
    )
    done = run([*sandbox, *user, "bash", "-c", script, "bash", *race], place, env)
    assert "dnf_reason" in done.stderr and "Compiling" not in done.stderr
    *_, last = done.stdout.splitlines()
    assert last.startswith("Results: "), "something was written to the installation"


@pytest.mark.skipif(not has("bwrap"), reason="there is no bubblewrap to hide things with")
def test_what_only_linux_has_is_not_needed(copy):
    """As on macOS: no /proc, /sys and /dev/shm, no affinities, no fork, and no other program."""
    place = copy("place")
    hidden = [word for folder in ("/proc", "/sys", "/dev/shm") for word in ("--tmpfs", folder)]
    # On Linux, Drake looks where its program is, and threadpoolctl, which libraries there are.
    program = ["--symlink", os.path.realpath(sys.executable), "/proc/self/exe"]
    program += ["--ro-bind", place / "airrace" / "py.typed", "/proc/self/maps"]  # it is empty
    sandbox = [shutil.which("bwrap"), "--bind", "/", "/", "--dev", "/dev", *hidden, *program]
    (place / "sitecustomize.py").write_text(
        "import os\n"
        "for name in [name for name in dir(os) if name.startswith(('sched_', 'SCHED_', 'pidfd'))]:\n"
        "    delattr(os, name)\n"
        "del os.fork, os.memfd_create\n"
    )
    env = environment(place, PATH="/nowhere")
    code = (
        "import sys; from airrace.commands.app import main\n"
        "from airrace.common.processes import processors, real_time_priority\n"
        "from airrace.hitl.link.probe import _kernel_setting as setting\n"
        "from airrace.league.sandbox import why_no_sandbox\n"
        "assert processors() > 0 and setting('core/rmem_max') == 0 and why_no_sandbox()\n"
        "with real_time_priority() as had: assert not had\n"
        "sys.exit(main(sys.argv[1:]))"
    )
    race = [sys.executable, "-P", "-c", code, *RACE[3:], "out"]
    done = run([*sandbox, "--", *race], place, env)
    check_result(place / "out")
    assert "Compiling" not in done.stderr


def test_no_two_files_differ_in_upper_and_lower_case_only():
    """They would be one on macOS and on Windows' drives."""
    names = [
        path.relative_to(ROOT).as_posix()
        for folder in ("airrace", "benchmarks", "docs", "examples", "models", "tests", "tools")
        for path in (ROOT / folder).rglob("*")
        if "__pycache__" not in path.parts
    ]
    assert len({name.lower() for name in names}) == len(names)
