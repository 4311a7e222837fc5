"""The options of tools/arm64_test.bash, and what it says where it cannot run."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.tools.test_setup_scripts import BASH, assert_one_sentence, write_executable

SCRIPT = Path(__file__).resolve().parents[2] / "tools" / "arm64_test.bash"
NEEDS = ["debootstrap", "qemu-aarch64-static", "ip", "sshd"]


@pytest.fixture
def run(tmp_path):
    """Runs it on a made-up computer: with these programs, for this user, on this machine."""

    def run(*options, programs=NEEDS, user=0, machine="x86_64", **more):
        commands = tmp_path / "commands"
        shutil.rmtree(commands, ignore_errors=True)
        commands.mkdir()
        for name in ("cat", "dirname", "mkdir", "readlink", "stat"):
            (commands / name).symlink_to(shutil.which(name))
        for name in programs:
            write_executable(commands / name, f"#!{BASH}\n")
        write_executable(commands / "id", f"#!{BASH}\necho {user}\n")
        write_executable(commands / "uname", f"#!{BASH}\necho {machine}\n")
        write_executable(commands / "unshare", f'#!{BASH}\necho "$@"\n')
        return subprocess.run(
            [BASH, SCRIPT, *options],
            env={"HOME": str(tmp_path / "home"), "PATH": str(commands), **more},
            capture_output=True,
            text=True,
        )

    return run


@pytest.mark.parametrize("option", ["--help", "-h"])
def test_help(run, option):
    done = run(option, programs=[], user=1000)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("usage: ") and "--folder" in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 80


@pytest.mark.parametrize(
    "options, folder",
    [
        ([], "home/.cache/airrace/arm64"),
        (["--folder", "{}/my root"], "my root"),
        (["--folder={}/mine"], "mine"),
    ],
)
def test_it_goes_on_in_mounts_of_its_own_with_the_folder(run, tmp_path, options, folder):
    done = run(*[each.format(tmp_path) for each in options])
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"--mount {SCRIPT} --folder {tmp_path / folder}\n"
    assert (tmp_path / folder).is_dir()


@pytest.mark.parametrize(
    "options, words",
    [
        (["--folder"], "--folder needs a folder"),
        (["--folder="], "--folder needs a folder"),
        (["--fodler", "x"], "no option --fodler"),
        (["x"], "no option x"),
    ],
)
def test_bad_options(run, options, words):
    done = run(*options)
    assert (done.returncode, done.stdout) == (2, "")
    assert_one_sentence(done.stderr)
    assert words in done.stderr


@pytest.mark.parametrize(
    "computer, words",
    [
        ({"user": 1000}, "run it with sudo"),
        ({"machine": "aarch64"}, "run ./test.bash on it"),
        ({"programs": ["ip", "sshd"]}, "apt-get install debootstrap qemu-user-static'"),
        ({"programs": NEEDS[:-1]}, "apt-get install openssh-server'"),
    ],
)
def test_what_is_missing_is_said_in_one_sentence(run, tmp_path, computer, words):
    done = run(**computer)
    assert (done.returncode, done.stdout) == (2, "")
    assert_one_sentence(done.stderr)
    assert words in done.stderr
    assert not (tmp_path / "home").exists()


def test_a_folder_that_others_may_write_to_is_refused(run, tmp_path):
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    done = run("--folder", tmp_path / "open", AIRRACE_ARM64_UNSHARED="1")
    assert (done.returncode, done.stdout) == (2, "")
    assert_one_sentence(done.stderr)
    assert f"others than root may write to {tmp_path / 'open'}," in done.stderr
