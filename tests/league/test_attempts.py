"""The audit hook, which cannot be taken back: in processes of their own."""

import subprocess
import sys

from airrace.league.attempts import MARK

BEGIN = """
import os, socket, sys
from airrace.league.attempts import Allowed, note_attempts
note_attempts(Allowed(read={read!r}, write={write!r}, hidden={hidden!r}))
def quietly(do):
    try:
        do()
    except Exception:
        pass
"""


def attempts(tmp_path, code):
    """The attempts of a process that may read tmp_path/race and write tmp_path/own."""
    for name in ("race", "race/tracks", "race-2", "own", "own/tracks"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text("x")
    begin = BEGIN.format(
        read=(str(tmp_path / "race"),),
        write=(str(tmp_path / "own"),),
        hidden=(str(tmp_path / "race" / "tracks"), str(tmp_path / "own" / "tracks")),
    )
    command = [sys.executable, "-c", begin + code]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    lines = [line for line in done.stdout.splitlines() if line]
    assert all(line.startswith(MARK) for line in lines)
    return [line.removeprefix(MARK).replace(str(tmp_path), "") for line in lines]


def test_each_is_named_once(tmp_path):
    found = attempts(
        tmp_path,
        """
for _ in range(3):
    quietly(lambda: open("race-2/file"))
    quietly(lambda: open("race/tracks/file"))
    quietly(lambda: os.listdir("/root"))
    quietly(lambda: open("race/file", "a"))
    quietly(lambda: os.open("/nowhere", os.O_RDWR))
    quietly(lambda: open("/proc/1/environ"))
    quietly(lambda: socket.socket())
    quietly(lambda: os.system("true"))
    quietly(lambda: os.fork() or os._exit(0))
""",
    )
    assert found == [
        "read /race-2/file",
        "read /race/tracks/file",
        "read /root",
        "wrote to /race/file",
        "wrote to /nowhere",
        "read /proc/1/environ",
        "opened a socket",
        "started a process (os.system)",
        "started a process (os.fork)",
    ]


def test_what_is_hidden_is_so_also_where_one_may_write(tmp_path):
    found = attempts(
        tmp_path,
        """
quietly(lambda: open("own/tracks/file"))
quietly(lambda: os.listdir("own/tracks"))
open("own/file").read()
""",
    )
    assert found == ["read /own/tracks/file", "read /own/tracks"]


def test_a_folder_of_modules_may_be_listed_and_not_read(tmp_path):
    """The process begins in one; Python lists it to import, if a file came there meanwhile."""
    (tmp_path / "secret").write_text("x")
    found = attempts(
        tmp_path,
        """
import importlib
importlib.invalidate_caches()  # as if one had come
quietly(lambda: importlib.import_module("there_is_no_such_module"))
os.listdir(os.getcwd())
open("secret").read()
""",
    )
    assert found == ["read /secret"]


def test_to_import_the_simulator(tmp_path):
    found = attempts(tmp_path, "quietly(lambda: __import__('airrace.diagrams.simulation'))")
    assert "imported airrace.diagrams.simulation, which knows nothing of this race" in found


def test_what_an_autonomy_may_do(tmp_path):
    found = attempts(
        tmp_path,
        """
import json, decimal, threading
open("race/file").read()
os.listdir("race")
open("own/file", "w").close()
open(os.devnull, "w").close()
open("/proc/self/status").read()
threading.Thread(target=len, args=("",)).start()
""",
    )
    assert found == []


def test_there_is_an_end(tmp_path):
    code = "for i in range(200):\n    quietly(lambda: open(f'/nowhere/{i}'))\n"
    assert len(attempts(tmp_path, code)) == 50
