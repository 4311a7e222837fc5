"""airrace betaflight build, and what a command line says of the firmware."""

from pathlib import Path
from unittest.mock import Mock

import pytest

from airrace.betaflight import firmware
from airrace.betaflight.firmware import Firmware
from airrace.commands.app import main
from airrace.common.errors import UserError
from airrace.diagrams.race import run_race
from airrace.envs.options import EnvOptions, make_scenario
from airrace.hitl.command import ask_to_arm
from airrace.scenario import load_scenario


def test_it_builds_and_says_where(monkeypatch, capsys):
    seen = []

    def build(show, source, again):
        show("compiling", 0.5)
        seen.append((source, again))
        return Firmware(Path("/cache/program"), Path("/cache/library"), "4.6.0")

    monkeypatch.setattr(firmware, "build_firmware", build)
    assert main(["betaflight", "build", "--source", "package.tar.gz"]) == 0
    assert "Betaflight 4.6.0 is in /cache." in capsys.readouterr().out
    assert main(["betaflight", "build", "--again"]) == 0
    assert seen == [(Path("package.tar.gz"), False), (None, True)]


def test_without_it_a_race_names_the_remedy(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    race = ["race", "--flight_controller", "betaflight", "--output", str(tmp_path / "run")]
    assert main([*race, "--no-meshcat", "--map", "track", "--renderer", "none"]) == 2
    assert "airrace betaflight build" in capsys.readouterr().err
    assert main([*race, "-s", "HITL"]) == 2
    assert "without -s" in capsys.readouterr().err


def test_who_cannot_command_it_is_told(capsys):
    for text, words in (
        ("{flight_controller: px4}", "internal, betaflight, msp:PLACE"),
        ("{flight_controller: betaflight, policy: learned}", "A policy commands the rotors"),
        ("{radio_failures: [{}]}", "radio_failures is for Betaflight"),
        ("{betaflight_mode: angle}", "betaflight_mode is for Betaflight"),
        ("{flight_controller: betaflight, betaflight_mode: acro}", "one of rates, angle"),
        ("{betaflight_config: team.txt}", "betaflight_config is for Betaflight"),
        ("{flight_controller: betaflight, radio_failures: [{kind: loud}]}", "one of silent"),
    ):
        assert main(["race", "--scenario_text", text]) == 2
        assert words in capsys.readouterr().err


def test_a_board_is_commanded_beside_it(tmp_path, capsys):
    dump = tmp_path / "dump.txt"
    dump.write_text("mixer QUADX\n")
    place = ["--flight_controller", f"msp:{tmp_path}/ttyACM0"]
    for words, said in (
        (["--allow_arming"], "add --flight_controller msp:PLACE"),
        (place, "what its command line prints"),
        (["--flight_controller", "betaflight"], "add --flight_controller msp:PLACE"),
        ([*place, "--betaflight_config", str(dump)], "do not say"),
    ):
        assert main(["hitl", "autonomy", "--output", str(tmp_path / "out"), *words]) == 2
        assert said in " ".join(capsys.readouterr().err.split())
    text = f"{{flight_controller: 'msp:/dev/ttyACM0', betaflight_config: {dump}}}"
    assert main(["race", "--scenario_text", text]) == 2
    assert "that a person starts beside it" in capsys.readouterr().err


def test_a_person_arms_by_a_word_in_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", Mock(isatty=lambda: False))
    with pytest.raises(UserError, match="Arming is a person's act"):
        ask_to_arm()
    monkeypatch.setattr("sys.stdin", Mock(isatty=lambda: True))
    for word in ("arm", "", "yes"):
        monkeypatch.setattr("builtins.input", lambda question, word=word: word)
        with pytest.raises(UserError, match="is not armed"):
            ask_to_arm()
    monkeypatch.setattr("builtins.input", Mock(side_effect=EOFError))  # Ctrl-D
    with pytest.raises(UserError, match="is not armed"):
        ask_to_arm()
    monkeypatch.setattr("builtins.input", lambda question: "ARM")
    ask_to_arm()
    assert capsys.readouterr().out.count("Take all propellers off") == 6


def test_what_cannot_fly_it_says_so(tmp_path):
    scenario = load_scenario(scenario_text="{flight_controller: betaflight}")
    with pytest.raises(UserError, match="only `airrace race` flies"):
        run_race(scenario, tmp_path)
    assert not [*tmp_path.iterdir()]
    with pytest.raises(UserError, match="flight_controller internal"):
        make_scenario(EnvOptions(scenario={"flight_controller": "betaflight"}))


def test_a_build_that_fails_is_one_sentence(monkeypatch, capsys):
    def build(show, source, again):
        raise UserError("Betaflight is built with gcc and make, and gcc is missing.")

    monkeypatch.setattr(firmware, "build_firmware", build)
    assert main(["betaflight", "build"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
