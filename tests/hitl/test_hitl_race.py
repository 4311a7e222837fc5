"""HITL as people run it: two processes, in a network of their own."""

import json
import os
import re
import signal
import subprocess
import sys
import time

import pytest

from airrace.commands.app import main
from airrace.common.patience import patient
from airrace.common.resources import models_path
from airrace.hitl.autonomy_process import PILOT_TICKS
from airrace.hitl.checkpoint import CHECKPOINT
from airrace.hitl.companion import OUTPUT, READY
from airrace.hitl.hitl_race import default_url
from airrace.hitl.navigator_process import NAVIGATOR_TICKS

pytestmark = pytest.mark.skipif(
    os.geteuid() != 0
    or subprocess.run(["unshare", "-n", "ip", "link"], capture_output=True, check=False).returncode
    != 0,
    reason="a network of one's own (unshare -n) takes root",
)
# LCM goes over the loopback of a namespace that nobody else is in.
NETWORK = [
    "unshare",
    "-n",
    "bash",
    "-c",
    'ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && "$@"',
    "--",
]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(models_path().parent), "OMP_NUM_THREADS": "1"}
SMALL = "{camera: {width: 640, height: 360}, referee: {time_limit: 2.5}}"


def start(*command, **options):
    return subprocess.Popen(
        [*NETWORK, *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=ENVIRONMENT,
        start_new_session=True,
        **options,
    )


def race(output, hexagon, *options, text=SMALL, report=False):
    return [
        sys.executable,
        "-m",
        "airrace",
        "race",
        "--no-meshcat",
        "--report" if report else "--no-report",
        "--laps",
        "1",
        "--track",
        hexagon,
        "--output",
        str(output),
        "--scenario_text",
        text,
        *options,
    ]


def hitl(*options):
    return [sys.executable, "-m", "airrace", *map(str, options)]


def load(folder):
    return json.loads((folder / "race.json").read_text())


def fly_in_one_process(folder, hexagon, *options):
    """Flies the first seconds of a race; its results are in a folder, "sitl"."""
    assert main(race(folder / "sitl", hexagon, *options)[3:]) == 1
    assert load(folder / "sitl")["dnf_reason"].startswith("ran out of time")


def check_lockstep(folder, name):
    """Checks that a race over LCM, by the name of its folder, is the one in "sitl"."""
    sitl, hitl = (load(folder / each) for each in ("sitl", name))
    walls = [result.pop("wall") for result in (sitl, hitl)]
    assert sitl == hitl
    assert sitl["exploration"]["events"][-1]["state"] == "TAKE_OFF"
    assert [wall["simulation"] for wall in walls] == ["SITL", "HITL"]
    assert walls[1]["link"]["mode"] == "lockstep"
    maps = [
        (folder / path / "map_statistics.json").read_text()
        for path in ("sitl", name, f"{name}/autonomy")
    ]
    assert maps[0] == maps[1] == maps[2]


@pytest.mark.slow
def test_lockstep_equals_sitl_to_the_last_bit(hexagon, tmp_path):
    """With an estimator in the autonomy, and a key; without, see the next test."""
    options = ("--estimator", "vio")
    fly_in_one_process(tmp_path, hexagon, *options)
    key = tmp_path / "link.key"
    key.touch(0o600)
    key.write_bytes(bytes(range(32)))
    options = (*options, "-s", "HITL", "--lockstep", "--link_key", str(key))
    process = start(*race(tmp_path / "hitl", hexagon, *options))
    text = process.communicate(timeout=patient(120))[0]
    assert process.returncode == 1 and "ran out of time" in text, text
    check_lockstep(tmp_path, "hitl")


@pytest.mark.repeats
def test_two_races_at_once_do_not_disturb_each_other(hexagon, tmp_path):
    """In one network: each has an LCM port of its own. Both equal SITL to the last bit."""
    options = ("--estimator", "truth")
    fly_in_one_process(tmp_path, hexagon, *options)
    first, second = (
        " ".join(
            f"'{word}'"
            for word in race(tmp_path / name, hexagon, *options, "-s", "HITL", "--lockstep")
        )
        for name in ("first", "second")
    )
    script = tmp_path / "both.sh"
    script.write_text(f"{first} & {second}; echo second $?; wait $!; echo first $?\n")
    text = start("bash", str(script)).communicate(timeout=patient(180))[0]
    assert "second 1" in text and "first 1" in text, text
    for name in ("first", "second"):
        assert load(tmp_path / name)["dnf_reason"].startswith("ran out of time"), text
        check_lockstep(tmp_path, name)


def test_default_urls():
    urls = {default_url("local") for _ in range(2)}
    assert len(urls) == 2 and all(url.endswith("?ttl=0") for url in urls)
    assert default_url("none") == "udpm://239.255.76.67:7667?ttl=0"
    assert default_url("user@10.0.0.2") == "udpm://239.255.76.67:7667?ttl=1"


@pytest.mark.slow
def test_in_real_time_slowed_down(hexagon, tmp_path):
    """At a quarter of the speed, so that a busy machine keeps up."""
    options = ("-s", "HITL", "--realtime_rate", "0.25")
    text = SMALL.replace("2.5", "1.2")
    process = start(*race(tmp_path / "out", hexagon, *options, text=text, report=True))
    text = process.communicate(timeout=patient(120))[0]
    assert process.returncode == 1, text
    result = load(tmp_path / "out")
    assert re.search("autonomy: airrace: 0.25 x real time with .* % to spare", text) or (
        "--realtime_rate 0.25" in text  # a machine that is busier still
    )
    assert f"autonomy: {READY}" in text and "ran out of time in state TAKE_OFF" in text
    link = result["wall"]["link"]
    assert link["mode"] == "realtime" and link["watchdog"]["landings"] == 0
    assert result["wall"]["seconds"] > 4.8
    received = [each["datagrams"]["received"] for each in (link, link["pilot"], link["navigator"])]
    assert min(received) > 1000
    assert link["navigator"]["channels"]["AIRRACE_CAMERA"]["received"] > 10
    commands = link["channels"]["AIRRACE_ROTOR_SPEED_COMMAND"]
    assert commands["received"] > 300 and commands["dropped"] == {}
    for name in ("checkpoint.pickle", PILOT_TICKS, NAVIGATOR_TICKS):
        assert (tmp_path / "out/autonomy" / name).exists()
    assert (tmp_path / "out/report.html").exists()
    ticks = json.loads((tmp_path / "out/autonomy" / PILOT_TICKS).read_text())["wall"]
    assert 500 < ticks["count"] < 1200  # of 500 Hz, in 1.2 s and until it is told of the end


@pytest.mark.repeats
@pytest.mark.parametrize("victim", ["autonomy", "navigator"])
def test_an_autonomy_that_is_killed_ends_the_race_and_says_so(hexagon, tmp_path, victim):
    text = "{camera: {width: 640, height: 360}, referee: {time_limit: 60.0}}"
    process = start(
        *race(tmp_path / "out", hexagon, "-s", "HITL", "--realtime_rate", "0.5", text=text)
    )
    try:
        for line in process.stdout:
            if "TAKE_OFF" in line:
                break
        time.sleep(2.0)  # a second of simulated time: on the way up
        group = _autonomy_group(process.pid)
        if victim == "autonomy":
            os.killpg(group, signal.SIGKILL)
        else:
            os.kill(_navigator_of(group), signal.SIGKILL)
        rest = process.communicate(timeout=patient(90))[0]
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    result = load(tmp_path / "out")
    assert process.returncode == 1, rest
    assert not result["finished"] and result["collisions"] == 0
    assert "the autonomy fell silent at" in result["dnf_reason"]
    assert "landed by itself" in result["dnf_reason"]
    assert result["wall"]["link"]["watchdog"]["landings"] == 1
    assert json.loads((tmp_path / "out/map.json").read_text())["time_s"] > 0.0
    assert (tmp_path / "out/autonomy/map.json").exists()
    why = "(its navigator was killed: SIGKILL)"
    assert (why in result["dnf_reason"]) == (victim == "navigator")


def _navigator_of(pilot):
    import psutil

    children = psutil.Process(pilot).children()
    return next(c.pid for c in children if "airrace.hitl.navigator_process" in c.cmdline())


def _autonomy_group(parent):
    """Returns the process group of the autonomy that a race has started."""
    import psutil

    children = psutil.Process(parent).children(recursive=True)
    return next(c.pid for c in children if "autonomy" in c.cmdline() and c.pid == os.getpgid(c.pid))


@pytest.mark.repeats
def test_doctor_and_the_simulations_death(tmp_path):
    """The doctor measures a link; then nobody comes, and the autonomy gives up."""
    script = tmp_path / "both.sh"
    autonomy = hitl("hitl", "autonomy", "--patience", "4", "--output", tmp_path / OUTPUT)
    doctor = hitl("doctor", "--link", "--duration", "1")
    script.write_text(
        f"{' '.join(autonomy)} & {' '.join(doctor)}; echo doctor $?; wait $!; echo autonomy $?\n"
    )
    process = start("bash", str(script))
    text = process.communicate(timeout=patient(90))[0]
    assert "round trip" in text and "pictures lost" in text
    assert "doctor 0" in text or "The link cannot carry a race" in text, text
    assert "autonomy 2" in text and "No simulation answered within 4 s" in text


@pytest.mark.parametrize(
    "options, sentence",
    [
        (("--lockstep",), "--lockstep is for hardware in the loop"),
        (("-s", "HITL", "--companion", "nobody"), "--companion 'nobody' names no user"),
        (("-s", "HITL", "--lcm_url", "nonsense"), "--lcm_url nonsense cannot be opened"),
        (("-s", "HITL", "--link_key", "/nothing"), "--link_key /nothing cannot be read"),
        (("--link_key", "/nothing"), "--link_key is for hardware in the loop"),
        (
            ("-s", "HITL", "--scenario_text", "{systems: {explorer: 'nothing:here'}}"),
            "systems.explorer: 'nothing:here' cannot be imported",
        ),
    ],
)
def test_bad_input_is_one_sentence(options, sentence, tmp_path, capsys):
    assert main(["race", "--no-meshcat", "--output", str(tmp_path / "out"), *options]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if "Compiling" not in line]
    assert len(said) == 1 and said[0].startswith(f"airrace: {sentence}"), said
    assert not (tmp_path / "out").exists()


@pytest.mark.repeats
@pytest.mark.parametrize(
    "victim, number, reason",
    [
        ("race", "INT", "interrupted"),
        ("race", "KILL", "not over yet"),
        ("second", "KILL", r"the autonomy fell silent at .*, and the drone landed by itself"),
        (
            "second",
            "TERM",
            r"the autonomy fell silent at .* \(it was told to stop\), and the drone",
        ),
    ],
)
def test_an_autonomy_that_starts_again_goes_on(victim, number, reason, hexagon, tmp_path):
    """It is killed on its way to gate 1, and another process resumes with its checkpoint.

    Then one of them is ended by a signal.
    """
    text = "{camera: {width: 640, height: 360}, referee: {time_limit: 60.0}, link_delay: 0.2}"
    scenario = ["--scenario_text", text.replace("{camera", f"{{track: {hexagon}, laps: 1, camera")]
    first, second = (
        " ".join(
            f"'{word}'"
            for word in hitl("hitl", "autonomy", "--output", tmp_path / name, *scenario, *options)
        )
        for name, options in (("first", ()), ("second", ("--resume", tmp_path / "first")))
    )
    simulation = " ".join(
        f"'{word}'"
        for word in race(
            tmp_path / "out",
            hexagon,
            "-s",
            "HITL",
            "--companion",
            "none",
            "--realtime_rate",
            "0.2",  # so slowly that a busy machine starts the second one before the drone lands
            text=text,
        )
    )
    log, flies = tmp_path / "log", tmp_path / "second" / CHECKPOINT
    script = tmp_path / "all.sh"
    script.write_text(f"""
        set -m  # or bash keeps Ctrl-C from what runs in the background
        {first} & first=$!
        {simulation} > {log} & race=$!
        until grep -q FLY_TO_GATE {log} 2>/dev/null; do sleep 0.1; done
        sleep 2; kill -KILL $first; sleep 2
        {second} & second=$!
        until [ -e {flies} ] || ! kill -0 $race; do sleep 0.1; done
        sleep 10; kill -{number} ${victim}; wait $race
        wait $second; echo second $?
        cat {log}
    """)
    text = start("bash", str(script)).communicate(timeout=patient(300))[0]
    result = load(tmp_path / "out")
    assert re.match(reason, result["dnf_reason"]), text
    codes = {"race-INT": 0, "race-KILL": 3, "second-KILL": 137, "second-TERM": 1}
    assert f"second {codes[f'{victim}-{number}']}" in text, text
    if number == "KILL" and victim == "race":
        return
    watchdog = result["wall"]["link"]["watchdog"]
    # Perhaps once more, while it reads its machine code from the disk, and when it is ended.
    assert watchdog["hovers"] in (1, 2, 3) and result["collisions"] == 0
    # One that had started anew would have taken off again.
    states = [event["state"] for event in result["exploration"]["events"]]
    assert states.count("TAKE_OFF") == 1 and "FLY_TO_GATE" in states
