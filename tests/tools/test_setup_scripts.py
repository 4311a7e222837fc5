"""Tests run.bash, test.bash, tools/setup.bash and the locks.

The scripts run in a copy of their part of the checkout, with stand-ins for the
interpreters and nothing else of the system's on PATH but the few commands they
need: no network, no real .venv.
"""

import os
import shlex
import shutil
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
BASH = shutil.which("bash")
COMMANDS = ["bash", "cp", "dirname", "flock", "id", "mkdir", "mv", "readlink", "rm", "sleep"]

# Stands in for an interpreter. What it is asked to run with -c is run for
# real, under the version number it claims, but for the search for system
# libraries; venv, pip and programs are not, and leave a line in the log.
FAKE_PYTHON = """\
#!{bash}
case "$*" in
  "-I -c "*" drake" | "-I -c "*" drake rendering sandbox")
    [ ! -e {log}.lacks ] || echo "$(<{log}.lacks)" ;;
  "-I -c "*)
    exec {real} -I -c 'import sys; sys.version_info = {version}; exec(sys.argv.pop(1))' "${{@:3}}" ;;
  "-I -m venv --clear "*)
    echo venv >>{log}
    mkdir -p "$5/bin" "$5/lib/python3.12/site-packages"
    cp "$0" "$5/bin/python" ;;
  "-I -m pip "*)
    echo "pip ${{*:4}}" >>{log}
    sleep {pip_seconds}
    [ ! -e {log}.pip-fails ] || {{ echo "no such wheel"; exit 1; }}
    case "$*" in *requirements-uv.lock)
      cp {log}.uv "${{0%/*}}/uv" ;;
    esac ;;
  *)
    echo "$PWD: $*" ;;
esac
"""

# Stands in for the uv that pip puts into .venv.
FAKE_UV = """\
#!{bash}
echo "uv $*" >>{log}
[ ! -e {log}.uv-fails ] || {{ echo "no such index"; exit 1; }}
"""


def write_executable(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)
    return path


class Sandbox:
    """A checkout, a PATH and a home directory of their own."""

    def __init__(self, folder):
        self.checkout = folder / "the checkout"  # a space, to test the quoting
        self.log = folder / "log"
        self.path = [folder / "commands"]
        self.env = {"HOME": str(folder / "home"), "PYENV_ROOT": str(folder / "pyenv")}
        self.folder = folder
        self.path[0].mkdir()
        for command in COMMANDS:
            if found := shutil.which(command):
                (self.path[0] / command).symlink_to(found)
        for name in ["run.bash", "test.bash", "tools/setup.bash"]:
            (self.checkout / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, self.checkout / name)
        self.lock = self.checkout / "requirements-run.lock"
        self.lock.write_text("drake==1.58.0 --hash=sha256:0\n")
        self.whole = self.checkout / "requirements.lock"
        self.whole.write_text("drake==1.58.0 --hash=sha256:0\npytest==9.0.0 --hash=sha256:0\n")
        uv = FAKE_UV.format(bash=BASH, log=shlex.quote(str(self.log)))
        write_executable(Path(f"{self.log}.uv"), uv)

    def add_python(self, path, version=(3, 12), pip_seconds=0):
        return write_executable(
            self.folder / path,
            FAKE_PYTHON.format(
                bash=BASH,
                real=shlex.quote(sys.executable),
                version=version,
                log=shlex.quote(str(self.log)),
                pip_seconds=pip_seconds,
            ),
        )

    def add_to_path(self, *names):
        self.path += [self.folder / name for name in names]

    def start(self, *command, cwd=None):
        return subprocess.Popen(
            [BASH, *map(str, command)],
            cwd=cwd or self.folder,
            env={**self.env, "PATH": os.pathsep.join(map(str, self.path))},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def run(self, *command, cwd=None):
        process = self.start(*command, cwd=cwd)
        process.out, process.err = process.communicate(timeout=30)
        return process

    def test(self):
        return self.run(self.checkout / "test.bash")

    def race(self, *options, cwd=None):
        return self.run(self.checkout / "run.bash", *options, cwd=cwd)

    def find_python(self):
        source = shlex.quote(str(self.checkout / "tools/setup.bash"))
        return self.run("-euo", "pipefail", "-c", f'source {source}; find_python; echo "$python"')

    def steps(self):
        """Empties the log of what the fake interpreters did."""
        steps = self.log.read_text().splitlines() if self.log.exists() else []
        self.log.unlink(missing_ok=True)
        return [step.split()[0] for step in steps]


@pytest.fixture
def sandbox(tmp_path):
    return Sandbox(tmp_path)


def assert_one_sentence(err):
    assert err.startswith("airrace: ") and err.endswith(".\n"), err
    assert err.count("\n") == 1, err


# Finding an interpreter.


def test_skips_shims_and_unsuitable_versions_and_finds_one_of_pyenv(sandbox):
    for name in ("python3.12", "python3"):
        write_executable(sandbox.folder / "shims" / name, f"#!{BASH}\nexit 127\n")
    sandbox.add_python("old/python3", (3, 11))
    sandbox.add_python("too new/python3", (3, 15))
    sandbox.add_python("pyenv/versions/3.11.7/bin/python", (3, 11))
    good = sandbox.add_python("pyenv/versions/3.13.0/bin/python", (3, 13))
    sandbox.add_to_path("shims", "old", "too new")
    found = sandbox.find_python()
    assert (found.returncode, found.out, found.err) == (0, f"{good}\n", "")


def test_no_python(sandbox):
    sandbox.add_python("old/python3", (3, 11))
    sandbox.add_to_path("old")
    result = sandbox.race()
    assert (result.returncode, result.out) == (2, "")
    assert_one_sentence(result.err)
    assert "python3-venv" in result.err and "uv" in result.err
    assert not (sandbox.checkout / ".venv").exists()


def test_asks_uv_to_install_one(sandbox):
    good = sandbox.add_python("uv's/python3.12")
    installs = sandbox.folder / "installs"
    write_executable(
        sandbox.folder / "bin/uv",
        textwrap.dedent(f"""\
            #!{BASH}
            case "$*" in
              "python install "*) echo yes >"{installs}" ;;
              "python find "*) [ -e "{installs}" ] && echo "{good}" ;;
            esac
        """),
    )
    sandbox.add_to_path("bin")
    for _ in range(2):  # the second time it is found
        assert sandbox.find_python().out == f"{good}\n"


def test_airrace_python_goes_first_and_must_work(sandbox):
    sandbox.add_python("good/python3.12")
    sandbox.add_to_path("good")
    sandbox.env["AIRRACE_PYTHON"] = str(sandbox.add_python("mine/python", (3, 13)))
    assert sandbox.find_python().out == sandbox.env["AIRRACE_PYTHON"] + "\n"
    sandbox.env["AIRRACE_PYTHON"] = "/nowhere/python"
    result = sandbox.find_python()
    assert (result.returncode, result.out) == (2, "")
    assert_one_sentence(result.err)


# Setting .venv up.


@pytest.fixture
def ready(sandbox):
    """A sandbox whose .venv is set up."""
    sandbox.add_python("good/python3.12")
    sandbox.add_to_path("good")
    assert sandbox.race().returncode == 0
    assert sandbox.steps() == ["venv", "pip", "uv"]
    return sandbox


def test_first_run_sets_up_and_the_next_does_not(sandbox):
    sandbox.add_python("good/python3.12")
    sandbox.add_to_path("good")
    elsewhere = sandbox.folder / "elsewhere"
    elsewhere.mkdir()
    expected = f"{elsewhere}: -P -m airrace race --track my track.yaml\n"

    first = sandbox.race("--track", "my track.yaml", cwd=elsewhere)
    assert (first.returncode, first.out) == (0, expected)
    assert "setting up .venv" in first.err
    _, pip, uv = sandbox.log.read_text().splitlines()
    for line, lock in ((pip, sandbox.checkout / "requirements-uv.lock"), (uv, sandbox.lock)):
        assert "--require-hashes" in line and f"--requirement {lock}" in line
    assert sandbox.steps() == ["venv", "pip", "uv"]
    # The checkout is on the interpreter's path, and may move.
    (site_packages,) = (sandbox.checkout / ".venv/lib").glob("python*/site-packages")
    line = (site_packages / "airrace.pth").read_text().strip()
    assert (site_packages / line).resolve() == sandbox.checkout
    sandbox.checkout = sandbox.checkout.rename(sandbox.folder / "moved")
    link = sandbox.folder / "link"
    link.symlink_to(sandbox.checkout / "run.bash")

    second = sandbox.run(link, "--track", "my track.yaml", cwd=elsewhere)
    assert (second.returncode, second.out, second.err) == (0, expected, "")
    assert sandbox.steps() == []


def test_a_copy_that_hides_the_checkout_is_refused(ready):
    (site_packages,) = (ready.checkout / ".venv/lib").glob("python*/site-packages")
    (site_packages / "airrace").mkdir()
    race = ready.race()
    assert race.returncode == 2 and race.out == ""
    assert_one_sentence(race.err)
    assert "hides this checkout" in race.err and "pip install -e" in race.err
    assert ready.steps() == []


def test_changed_lock_is_installed(ready):
    ready.lock.write_text("drake==1.59.0 --hash=sha256:0\n")
    assert "other versions" in ready.race().err
    assert ready.steps() == ["pip", "uv"]


def test_a_race_is_content_with_what_tests_take(ready):
    """So that the two scripts, each in turn, install nothing over and over."""
    tests = ready.test()
    assert (tests.returncode, tests.out.count("-m pytest")) == (0, 1)
    assert "requirements.lock asks for more" in tests.err
    assert f"--requirement {ready.whole}" in ready.log.read_text().splitlines()[-1]
    assert ready.steps() == ["pip", "uv"]
    assert ready.race().err == ready.test().err == ""
    assert ready.steps() == []


def test_pip_installs_what_uv_can_not(sandbox):
    sandbox.add_python("good/python3.12")
    sandbox.add_to_path("good")
    Path(f"{sandbox.log}.uv-fails").touch()
    race = sandbox.race()
    assert (race.returncode, race.err.count("no such index")) == (0, 0)
    assert "uv cannot install them, so that pip does" in race.err
    last = sandbox.log.read_text().splitlines()[-1]
    assert last.startswith("pip") and f"--requirement {sandbox.lock}" in last
    assert sandbox.steps() == ["venv", "pip", "uv", "pip"]


@pytest.mark.parametrize("change_lock", [True, False])
def test_failed_set_up_is_redone_from_scratch(ready, change_lock):
    if change_lock:
        ready.lock.write_text("drake==1.59.0 --hash=sha256:0\n")
    else:
        (ready.checkout / ".venv/bin/python").unlink()
    pip_fails = Path(f"{ready.log}.pip-fails")
    pip_fails.touch()
    failed = ready.race()
    assert (failed.returncode, failed.out) == (2, "")
    _, other_way, *output, sentence = failed.err.splitlines(keepends=True)
    assert_one_sentence(other_way)
    assert output == ["no such wheel\n"]
    assert_one_sentence(sentence)
    ready.steps()

    pip_fails.unlink()
    assert ready.race().returncode == 0
    assert ready.steps() == ["venv", "pip", "uv"]


@pytest.mark.parametrize("system, name", [("linux-gnu", "glibc"), ("darwin25", "Apple silicon")])
def test_a_failed_set_up_says_what_this_system_must_be(sandbox, system, name):
    """And without a network it says so soon: pip tries only once more."""
    sandbox.add_python("good/python3.12")
    sandbox.add_to_path("good")
    sandbox.env["OSTYPE"] = system
    Path(f"{sandbox.log}.pip-fails").touch()
    failed = sandbox.race()
    assert failed.returncode == 2 and name in failed.err
    assert failed.err.count("glibc") + failed.err.count("Apple") == 1
    pips = [line for line in sandbox.log.read_text().splitlines() if line.startswith("pip ")]
    assert len(pips) == 2 and all("--retries 1 " in line for line in pips)


@pytest.mark.parametrize("script", ["run.bash", "test.bash"])
@pytest.mark.parametrize("system", ["msys", "cygwin"])
def test_windows_is_told_of_wsl2(sandbox, script, system):
    sandbox.env["OSTYPE"] = system
    result = sandbox.run(sandbox.checkout / script)
    assert (result.returncode, result.out) == (2, "")
    assert_one_sentence(result.err)
    assert "WSL2" in result.err and not (sandbox.checkout / ".venv").exists()


@pytest.mark.skipif(not shutil.which("flock"), reason="there is no flock to wait with")
def test_two_at_once_set_up_once(sandbox):
    sandbox.add_python("good/python3.12", pip_seconds=0.3)
    sandbox.add_to_path("good")
    races = [sandbox.start(sandbox.checkout / "run.bash") for _ in range(2)]
    for race in races:
        out, err = race.communicate(timeout=30)
        assert (race.returncode, out.count("-m airrace race")) == (0, 1), err
    assert sandbox.steps() == ["venv", "pip", "uv"]


# Running the tests.


@pytest.mark.parametrize(
    "options", [["--all", "-k", "a or b"], ["-n", "4"], ["-n0", "-x"], ["--pdb"]]
)
def test_test_bash_runs_pytest_in_the_checkout(ready, options):
    """In several processes, unless it is told in how many."""
    result = ready.run(ready.checkout / "test.bash", *options)
    default = "-n 3 " if "-k" in options else ""
    expected = f"{ready.checkout}: -m pytest {default}{' '.join(options)}\n"
    assert (result.returncode, result.out) == (0, expected)


def test_race_needs_its_system_packages(ready):
    Path(f"{ready.log}.lacks").write_text("libglib2.0-0")
    result = ready.race()
    assert (result.returncode, result.out) == (2, "")
    assert_one_sentence(result.err)
    assert "apt-get install libglib2.0-0" in result.err


@pytest.mark.parametrize("user, apt_get_works", [(0, True), (0, False), (1000, True)])
def test_test_bash_installs_system_packages_for_root(ready, user, apt_get_works):
    """And whatever comes of it, the tests are run."""
    Path(f"{ready.log}.lacks").write_text("libegl1 libgl1-mesa-dri")
    write_executable(ready.folder / "bin/id", f"#!{BASH}\necho {user}\n")
    write_executable(
        ready.folder / "bin/apt-get",
        f'#!{BASH}\necho "apt-get $*" >>"{ready.log}"; echo noise\n'
        + ("" if apt_get_works else "exit 100\n"),
    )
    ready.path.insert(0, ready.folder / "bin")
    result = ready.run(ready.checkout / "test.bash")
    assert (result.returncode, result.out.count("-m pytest")) == (0, 1)
    log = ready.log.read_text() if ready.log.exists() else ""
    assert ("libegl1 libgl1-mesa-dri\n" in log) == (user == 0 and apt_get_works)
    assert ("apt-get" in log) == (user == 0)
    assert ("noise" in result.err) == (not apt_get_works)


def test_ci_runs_test_bash_and_nothing_else():
    _, command = (ROOT / ".ci/run").read_text(encoding="utf-8").splitlines()
    assert command == 'cd "$(dirname "$0")/.." && ./test.bash'
    for name in ("run.bash", "test.bash", ".ci/run", "tools/lock.bash"):
        assert os.access(ROOT / name, os.X_OK)


# The locks.

LOCKS = {"requirements.lock": ["dev"], "requirements-run.lock": []}  # to the extras in them
locks = pytest.mark.parametrize("lock", LOCKS)
every_lock = pytest.mark.parametrize("lock", [*LOCKS, "requirements-uv.lock"])


def locked(lock):
    """Returns [(requirement, hashes)] of a lock."""
    text = (ROOT / lock).read_text().replace("\\\n", "")
    result = []
    for line in text.splitlines():
        requirement, *hashes = line.split("--hash=")
        result.append((Requirement(requirement), [h.strip() for h in hashes]))
    return result


@every_lock
def test_lock_pins_exactly_and_with_hashes_and_holds_no_addresses(lock):
    text = (ROOT / lock).read_text()
    assert not [word for word in ("://", "file:", "--index", "--find-links", " @ ") if word in text]
    for requirement, hashes in locked(lock):
        assert [s.operator for s in requirement.specifier] == ["=="], requirement
        assert hashes and all(h.startswith("sha256:") for h in hashes), requirement
        assert not requirement.url


def test_what_running_takes_is_a_part_of_the_whole():
    """A companion gets the very files that the tests ran with."""
    everything, running = (
        {
            f"{requirement.name}{requirement.specifier}": hashes
            for requirement, hashes in locked(lock)
        }
        for lock in LOCKS
    )
    assert running.items() <= everything.items()
    names = {pin.partition("==")[0] for pin in running}
    assert "drake" in names and not {"pytest", "sphinx", "pyarrow", "debugpy"} & names


@locks
@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
@pytest.mark.parametrize("python", ["3.12", "3.13", "3.14"])
def test_lock_satisfies_pyproject(machine, python, lock):
    environment = {
        **default_environment(),
        "platform_machine": machine,
        "platform_system": "Linux",
        "python_full_version": f"{python}.0",
        "python_version": python,
        "sys_platform": "linux",
    }
    pins = {
        canonicalize_name(requirement.name): next(iter(requirement.specifier)).version
        for requirement, _ in locked(lock)
        if requirement.marker is None or requirement.marker.evaluate(environment)
    }
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = [each for extra in LOCKS[lock] for each in project["optional-dependencies"][extra]]
    for text in project["dependencies"] + extras:
        requirement = Requirement(text)
        name = canonicalize_name(requirement.name)
        assert name in pins, f"{name} is not in {lock}: run tools/lock.bash"
        assert requirement.specifier.contains(pins[name]), (
            f"{lock} has {name} {pins[name]}, not {text}: run tools/lock.bash"
        )
