"""The command line as a whole: its help, its version, its completion, its sentences."""

import subprocess
import sys

import pytest

from airrace import __version__
from airrace.commands.app import main, make_app
from airrace.common.command_line import typed_command

COMMANDS = "race replay report tables track evaluate hitl doctor new completion".split()


def test_help_names_every_subcommand(capsys):
    assert main([]) == 0
    text = capsys.readouterr().out
    assert all(f"│ {command} " in text for command in COMMANDS)
    assert text.index("│ race ") < text.index("│ evaluate ") < text.index("│ completion ")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_subcommand_has_help_of_80_columns(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main([command, "--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"Usage: airrace {command}")
    assert len("".join(lines)) > 200 and max(map(len, lines)) <= 88


def test_the_command_is_the_one_that_was_typed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for started, program, command in (
        (
            [".venv/bin/python", "-P", "-m", "airrace", "new"],
            "a/__main__.py",
            ".venv/bin/python -m airrace",
        ),
        ([f"{tmp_path}/my env/python", "-m", "airrace", "new"], "x", "'my env/python' -m airrace"),
        (["/usr/bin/python", "env/bin/airrace", "new"], "env/bin/airrace", "env/bin/airrace"),
        (["/usr/bin/python", "-m", "pytest", "new"], "pytest/__main__.py", "airrace"),
    ):
        monkeypatch.setattr(sys, "orig_argv", started)
        monkeypatch.setattr(sys, "argv", [program, "new"])
        assert typed_command() == command


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"{__version__}\n"


@pytest.mark.parametrize(
    "args, words",
    [
        (["rce"], 'Unknown command "rce". Did you mean "race"?'),
        (["race", "--trak", "hexagon"], "Unknown option: --trak. Did you mean --track?"),
        (["replay"], "RUN requires an argument"),
        (["replay", "a", "--lap", "2"], "--lap needs --align lap"),
        (["replay", "nowhere"], "nowhere/race.json cannot be read"),
        (["report", "nowhere"], "nowhere/race.json cannot be read"),
        (["tables", "nowhere", "--format", "xls"], 'Choose from: "csv", "parquet"'),
        (["track", "--gates", "7"], "7"),
        (["track", "--gates", "8.5"], "8.5 is no whole number"),
        (["track", "--plot", "track.txt"], "track.txt"),
        (["evaluate", "--workers", "0"], "--workers must be at least 1, not 0"),
        (["hitl", "pilot"], 'Unknown command "pilot"'),
        (["hitl", "autonomy", "--patience", "long"], 'unable to convert "long" into float'),
        (["doctor", "--lcm_url", "udpm://"], "add --link"),
        (["doctor", "--link", "--lcm_url", "nonsense"], "nonsense"),
        (["new", "drone"], "NAME requires an argument"),
        (["new", "plane", "x"], "Choose from"),
        (["completion", "tcsh"], "Choose from"),
        (["completion"], "SHELL requires an argument"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_one_sentence_for_bad_input(args, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(args) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("airrace: ") and err.count("\n") == 1, err
    assert words in err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_knows_every_subcommand_and_option(shell, capsys):
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(command in script for command in COMMANDS) and "scenario_text" in script


def test_the_completion_of_bash_completes():
    script = make_app().generate_completion(shell="bash")
    ask = """
COMP_WORDS=(airrace race --tra); COMP_CWORD=2; _airrace; printf '%s\\n' "${COMPREPLY[@]}"
"""
    answer = subprocess.run(["bash", "-c", script + ask], capture_output=True, text=True)
    assert answer.stdout.split() == ["--trajectory", "--track"], answer


def test_a_reader_that_leaves():
    """airrace completion bash | head -1"""
    command = f"'{sys.executable}' -m airrace completion bash | head -1"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    assert done.stderr == "" and done.stdout == "# Bash completion for airrace\n"


def test_importing_airrace_is_fast_and_offers_what_a_lesson_needs():
    """It imports neither Drake nor anything else that takes a second."""
    code = (
        "import sys, airrace; assert 'numpy' not in sys.modules and 'pydrake' not in sys.modules;"
        "assert all(name in dir(airrace) for name in airrace.__all__) and len(airrace.__all__) == 11;"
        "[getattr(airrace, name) for name in airrace.__all__]; assert callable(airrace.race);"
        "assert not hasattr(airrace, 'fly_to_the_moon')"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_an_old_python_is_told_so(tmp_path):
    """With the check's own words, read by a Python that says it is old."""
    from airrace.common.resources import models_path

    code = f"import sys; sys.path.insert(0, {str(models_path().parent)!r}); "
    code += "sys.version_info = (3, 10, 1); import airrace"
    old = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert old.returncode == 2 and old.stdout == ""
    assert old.stderr.count("\n") == 1 and "needs 3.12 or newer" in old.stderr


@pytest.mark.parametrize("system", ["win32", "cygwin"])
def test_windows_is_told_of_wsl2(system):
    """In one sentence, before anything is imported that is not there."""
    code = f"import sys, runpy; sys.platform = {system!r}; runpy.run_module('airrace')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.count("\n") == 1 and "WSL2" in done.stderr
