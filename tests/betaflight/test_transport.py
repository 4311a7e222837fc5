"""Races that the firmware flies, and how they end when it does not."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

from airrace.analysis.blackbox import RACE_BEGINS, read_blackbox
from airrace.betaflight.msp import open_msp
from airrace.betaflight.settings import lines_of
from airrace.betaflight.transport import find_settings, join_betaflight
from airrace.commands import race
from airrace.common.errors import UserError
from airrace.diagrams.race import run_race
from airrace.recording.race_events import StateSample
from airrace.scenario import load_scenario

BRIEF = """
map: track
camera: {renderer: none}
recording: {content: none}
flight_controller: betaflight
laps: 1
referee: {time_limit: 4.0}
"""


def fly(folder, text=BRIEF, sinks=()):
    """Returns race.json, the lines that were shown, and where the drone was each 0.1 s."""
    lines, samples = [], []

    def keep(event):
        if isinstance(event, StateSample):
            samples.append([event.time, *event.truth.position])

    folder.mkdir()
    scenario = load_scenario(scenario_text=text)
    scenario.check()
    with join_betaflight(scenario, folder, lines.append) as transport:
        sinks = [keep, *(make(transport) for make in sinks)]
        result = run_race(scenario, folder, transport=transport, sinks=sinks)
    return result, lines, samples


@pytest.mark.slow
def test_it_takes_off_and_leaves_its_settings(firmware, tmp_path):
    result, lines, samples = fly(tmp_path / "a")
    assert result["exploration"]["success"] and lines == []
    assert samples[-1][3] == pytest.approx(5.0, abs=0.1)
    log = read_blackbox(tmp_path / "a" / "betaflight.bfl")
    log["time"] -= RACE_BEGINS
    assert log["time"].iloc[0] < 0.0 and log["time"].iloc[-1] > samples[-1][0]
    on_pad, in_flight = log["time"] < 0.4, log["time"].between(3.0, 4.0)
    assert (log["motor[0]"][on_pad & (log["time"] > -0.2)] < 1050).all()
    assert log["motor[0]"][in_flight].mean() == pytest.approx(1539, abs=10)
    dump = (tmp_path / "a" / "betaflight.txt").read_text()
    assert "Betaflight / SITL" in dump and "set p_roll = 45" in dump


@pytest.mark.slow
def test_it_flies_in_its_angle_mode(firmware, tmp_path):
    # In its rate mode, sticks that ask for angles would turn it over.
    text = BRIEF.replace("4.0", "6.0") + "betaflight_mode: angle\n"
    _, _, samples = fly(tmp_path / "a", text)
    assert samples[36][3] == pytest.approx(5.0, abs=0.1)
    assert np.hypot(*np.subtract(samples[-1], samples[36])[1:3]) > 3.0  # it is on its lap
    assert samples[-1][0] == pytest.approx(6.0, abs=0.2)


@pytest.mark.repeats
def test_a_lap_is_flown_twice_alike(firmware, tmp_path):
    text = BRIEF.replace("time_limit: 4.0", "time_limit: 40.0")
    result, _, samples = fly(tmp_path / "a", text)
    assert result["finished"]
    assert fly(tmp_path / "b", text)[2] == samples


@pytest.mark.slow
def test_a_firmware_killed_in_flight_ends_the_race_with_its_results(firmware, tmp_path):
    times = []

    def killer(transport):
        def look(event):
            times.append(event.time)
            if event.time >= 2.0 and transport._process.problem is None:
                os.kill(transport._process.number, signal.SIGKILL)

        return look

    with pytest.raises(UserError, match=r"killed: SIGKILL; what was flown before is in .*/a\."):
        fly(tmp_path / "a", sinks=[killer])
    kept = json.loads((tmp_path / "a" / "race.json").read_text())
    assert kept["dnf_reason"] == "Betaflight was killed: SIGKILL"
    assert times[-1] < 2.5


@pytest.mark.slow
def test_a_firmware_without_commands_falls_back_on_its_own_failsafe(firmware, tmp_path):
    text = BRIEF + "radio_failures: [{time: 2.0}]\n"
    result, _, samples = fly(tmp_path / "a", text)
    assert result["dnf_reason"].startswith("hit the ground")
    assert "failsafe acted: it heard no commands from 2.0 s on" in result["dnf_reason"]
    assert 2.5 < samples[-1][0] < 4.0  # it fell


@pytest.mark.slow
def test_a_team_is_told_what_is_not_taken(firmware, shipped, tmp_path):
    team = tmp_path / "team.txt"
    wrong = [f"set no_such_{i} = 3" for i in range(4)]
    team.write_text("\n".join((shipped.read_text(), "set dyn_notch_count = 3", *wrong)))
    text = BRIEF.replace("4.0", "0.2") + f"betaflight_config: {team}\n"
    _, (line,), _ = fly(tmp_path / "a", text)
    assert "does not take 5 lines of" in line and "'set dyn_notch_count = 3'" in line
    kept = tmp_path / "a" / "betaflight.txt"
    assert line.endswith(f"and 2 more, see {kept}")
    comments = kept.read_text().splitlines()[1:6]
    assert all(f"# '{wanted}' (" in found for wanted, found in zip(wrong, comments[1:]))
    assert not {*wrong} & {*lines_of(kept)}  # they can be given again


def test_settings_that_cannot_be_read_are_said_before_anything_takes_a_while(
    firmware, tmp_path, monkeypatch
):
    monkeypatch.setattr(race, "fly", lambda *args, **options: pytest.fail("it is flown"))
    (tmp_path / "empty.txt").touch()
    for name, words in (("nope.txt", "cannot be read"), ("empty.txt", "no settings")):
        options = race.AnyRaceOptions(
            flight_controller="betaflight", betaflight_config=str(tmp_path / name)
        )
        with pytest.raises(UserError, match=words):
            race.fly_any(options)


@pytest.mark.slow
def test_settings_that_do_not_arm_are_refused_with_the_firmwares_reason(
    firmware, shipped, tmp_path
):
    team = tmp_path / "team.txt"
    team.write_text(f"{shipped.read_text()}set min_check = 750\n")
    with pytest.raises(UserError, match=r"does not arm \(.*THROTTLE.*\)"):
        fly(tmp_path / "a", BRIEF + f"betaflight_config: {team}\n")


def test_who_has_no_settings_is_told():
    with pytest.raises(UserError, match="no settings of Betaflight for this drone"):
        find_settings(load_scenario(scenario_text="{drone: vadr}"))


@pytest.mark.slow
def test_eight_rotors_take_off(firmware, tmp_path):
    result, _, samples = fly(tmp_path / "a", BRIEF + "drone: StarOne\n")
    assert result["exploration"]["success"]
    assert samples[-1][3] == pytest.approx(5.0, abs=0.3)  # it stands higher than the Default


@pytest.mark.repeats
def test_two_races_from_pixels_at_once_on_a_busy_computer_are_each_as_alone(firmware, tmp_path):
    text = BRIEF.replace("map: track\ncamera: {renderer: none}\n", "").replace("4.0", "9.0")
    _, _, alone = fly(tmp_path / "alone", text)
    folders = tmp_path / "a", tmp_path / "b"
    spin = [sys.executable, "-c", "while True: pass"]
    busy = [subprocess.Popen(spin) for _ in range(2)]
    try:
        with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
            flown = [pool.submit(fly, folder, text) for folder in folders]
            for each in flown:
                assert each.result()[2] == alone
    finally:
        for each in busy:
            each.kill()
            each.wait()
    assert alone[-1][0] > 8.9


@pytest.mark.slow
def test_in_real_time_others_may_look_at_it(firmware, tmp_path):
    seen, threads = {}, []

    def looker(transport):
        def ask():
            with open_msp(f"127.0.0.1:{transport._process.port}") as board:
                seen.update(status=board.status(), motors=board.motors()[:4])

        def look(event):
            if event.time >= 1.0 and not threads:
                threads.append(threading.Thread(target=ask))
                threads[0].start()

        return look

    text = BRIEF.replace("4.0", "2.0") + "simulator_config: {target_realtime_rate: 1.0}\n"
    _, (line,), _ = fly(tmp_path / "a", text, [looker])
    threads[0].join()
    assert "are at tcp://127.0.0.1:" in line
    assert seen["status"].armed and min(seen["motors"]) > 1100
