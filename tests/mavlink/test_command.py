import dataclasses as dc
import json
import re
import sys
import threading

import numpy as np
import pytest

from airrace.commands import app
from airrace.commands.app import main as command
from airrace.commands.race import AnyRaceOptions, fly_any
from airrace.common.errors import UserError
from airrace.mavlink import client_link
from airrace.mavlink import command as module
from airrace.mavlink.command import EPILOG, GrandPrixOptions, addresses, grand_prix_scenario
from airrace.mavlink.dialects import DIALECTS
from airrace.scenario.mavlink_config import QuirksConfig
from airrace.track import load_track
from tests.worlds.mavlink_client import UdpClient, arm


def main(*words):
    return command(["grand-prix", *map(str, words)])


def scenario(**options):
    return grand_prix_scenario(GrandPrixOptions(**options))


def test_the_defaults_are_the_qualifier():
    s = scenario()
    assert (s.track, s.drone, s.seed) == ("grand-prix", "vadr", 0)
    assert (s.camera.width, s.camera.height, s.camera.fps) == (640, 360, 30.0)
    assert s.simulator_config.target_realtime_rate == 1.0
    assert (s.mavlink.vq, s.mavlink.step, s.mavlink.time_limit) == (2, False, 480.0)
    assert s.mavlink.dialect == "official" and s.mavlink.quirks == QuirksConfig()


def test_options_win_over_the_scenario():
    s = scenario(vq=1, step=True, seed=3, scenario_text="{mavlink: {vq: 2, chunk_size: 700}}")
    assert (s.mavlink.vq, s.mavlink.step, s.mavlink.chunk_size, s.seed) == (1, True, 700, 3)
    assert s.simulator_config.target_realtime_rate == 0.0
    assert scenario(realtime_rate=0.5).simulator_config.target_realtime_rate == 0.5


def test_quirks_choose_the_dialect():
    assert scenario(quirks="none").mavlink.dialect == "none"
    assert scenario(scenario_text="{mavlink: {dialect: none}}").mavlink.dialect == "none"


@pytest.mark.parametrize("vq, gates, turns", [(1, 6, (5.0, 20.0)), (2, 17, (60.0, 360.0))])
def test_courses_are_like_the_official_ones(vq, gates, turns):
    """Six gates nearly in line, and 17 that wind through 200 m of a dark hall."""
    track = load_track(scenario(vq=vq, course="official-like").track)
    assert len(track.gates) == gates and track.surroundings == "hall"
    yaws = np.unwrap([gate.heading for gate in track.gates])
    assert turns[0] < np.rad2deg(np.ptp(yaws)) < turns[1]
    length = np.linalg.norm(np.diff(track.way(), axis=0), axis=1).sum()
    assert vq == 1 or length == pytest.approx(200.0, abs=15.0)


BAD = [
    (["--quirks", "odd"], "official"),
    (["--scenario_text", "{mavlink: {dialect: odd}}"], "must be one of official, none, not 'odd'"),
    (["--course", "official-like", "--track", "hexagon"], "--course and --track exclude"),
    (["--vq", "3"], "vq"),
    (["--step", "--realtime_rate", "1"], "--realtime_rate and --step exclude each other"),
    (["--client", "here"], "--client here and --picture_port 5600: give a host and a port"),
    (["--client", "127.0.0.1:99999"], "a port from 1 to 65535"),
    (["--client", "no.such.host.invalid:14550"], "cannot be found"),
    (["--client", "198.51.100.2:14550"], "is another computer: add --bind"),
    (["--picture_port", "0"], "a port from 1 to 65535"),
    (["--bind", "203.0.113.7"], "--bind 203.0.113.7 cannot be used"),
    (["--track", "hexagon"], "The track hexagon has pylons; a client flies square gates"),
    (["--track", "none"], "no track named 'none'"),
    (["-d", "StarOne"], "flies drones of four rotors, which the StarOne is not"),
    (["--scenario_file", "races"], "A client flies scenarios with an IMU"),
    (["--scenario_text", "{mavlink: {jpeg_quality: 0}}"], "mavlink.jpeg_quality must be"),
    (["--scenario_text", "{mavlink: {quirks: {imu_drop: 0.95}}}"], "imu_drop must be"),
    (["--scenario_text", "{disturbances: {gate_shift: 1.0}}"], "passed only once, and do not move"),
    (["--laps", "2"], "--laps"),
]


@pytest.mark.parametrize("words, sentence", BAD, ids=lambda v: " ".join(v) if v is not str else "")
def test_bad_input_is_one_sentence(words, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(*words, "--no-meshcat") == 2
    out, err = capsys.readouterr()
    assert err.startswith("airrace: ") and err.count("\n") == 1 and sentence in err
    assert not list(tmp_path.rglob("race.json"))


def test_the_examples_of_the_help_are_good():
    examples = re.findall(r"^  airrace grand-prix(.*?)(?:   .*)?$", EPILOG, re.M)
    assert len(examples) >= 5
    parse = app.make_app().parse_args
    for example in examples:
        _, bound, _ = parse(
            ["grand-prix", *example.split()], exit_on_error=False, print_error=False
        )
        options = bound.arguments.get("options", GrandPrixOptions())
        grand_prix_scenario(dc.replace(options, track=None))


@pytest.mark.parametrize(
    "words",
    [
        ["race", "-s", "MAVLINK", "--vq", "1"],
        ["race", "--vq", "1", "--simulation", "MAVLINK"],
        ["race", "--simulation=MAVLINK", "--vq", "1"],
    ],
)
def test_a_race_may_be_told_that_a_client_flies(words, monkeypatch):
    seen = []
    monkeypatch.setattr(
        module, "fly_grand_prix", lambda options: seen.append(options) or {"finished": True}
    )
    assert command(words) == 0
    assert seen == [GrandPrixOptions(vq=1)]


def test_what_is_no_clients_race_stays_one():
    for words in (["race", "-s", "HITL"], ["race", "-s"], ["track", "-s", "MAVLINK"], ["race"], []):
        assert app._for_clients(words) == words


def test_in_python_a_clients_race_is_its_own_command():
    with pytest.raises(UserError, match="airrace grand-prix"):
        fly_any(AnyRaceOptions(simulation="MAVLINK"))


def test_addresses():
    options = GrandPrixOptions(client="127.0.0.2:14600", picture_port=5700)
    expected = client_link.Addresses("127.0.0.2", 14600, 5700, "127.0.0.1", 14560, 5601, True)
    assert addresses(options, DIALECTS["official"]) == expected
    assert not addresses(options, DIALECTS["none"]).fixed_port


def test_without_pymavlink_it_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20.common", None)
    assert main("--no-meshcat") == 2
    assert "pip install 'airrace[mavlink]'" in capsys.readouterr().err


@pytest.mark.slow
def test_a_race_leaves_its_results(tmp_path, monkeypatch, capsys):
    """A client that is there, but never flies: it runs out of time."""
    monkeypatch.chdir(tmp_path)
    text = "{mavlink: {time_limit: 0.3, dialect: none}, recording: {content: light}}"
    with UdpClient() as client:

        def fly():
            client.hear(200.0)
            for _ in range(3):
                client.say(arm())
                client.hear()

        thread = threading.Thread(target=fly, daemon=True)
        thread.start()
        port, pictures = client.ports
        code = main(
            "--client", f"127.0.0.1:{port}", "--picture_port", pictures, "--realtime_rate", 0,
            "--scenario_text", text, "--output", "out", "--linger", 0,
        )  # fmt: skip
        thread.join(10.0)
    assert code == 1
    out = capsys.readouterr().out
    assert f"Client at 127.0.0.1:{port}." in out and "the race has started" in out
    assert "Did not finish: ran out of time; 0 of 17 gates" in out
    left = {path.name for path in (tmp_path / "out").iterdir()}
    assert left == {"race.json", "scenario.yaml", "race.mcap", "race.html"}
    assert command(["report", "out"]) == 0
    report = (tmp_path / "out" / "report.html").read_text()
    assert "ran out of time; 0 of 17 gates" in report and "not reached" in report
    assert report.count("<svg") == 2  # for a desk and for a phone
    data = json.loads((tmp_path / "out" / "race.json").read_text())
    assert data["wall"]["simulation"] == "MAVLINK" and data["gates"] == 17
    assert data["wall"]["link"]["received"] >= 1 and data["time_s"] is None
