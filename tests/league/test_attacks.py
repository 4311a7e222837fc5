"""What a clever student would try on a league. Each of these fails if its guard is taken away."""

import dataclasses as dc
import io
import json
import os
import subprocess
import sys
import threading
import time
import types

import numpy as np
import pytest
from rich.console import Console

from airrace.commands.app import main
from airrace.common.errors import UserError, exit_code
from airrace.common.resources import load_yaml
from airrace.common.words import printable
from airrace.evaluation.races_display import print_line
from airrace.hitl.link import phases
from airrace.hitl.link.codec import field_codec
from airrace.hitl.link.endpoint import AUTONOMY, SIMULATION, Endpoint
from airrace.hitl.link.socket_bus import SocketBus
from airrace.lcmtypes import lcmt_explorer_event
from airrace.league import season as season_module
from airrace.league.attempts import MARK
from airrace.league.display import print_ranking, words_of
from airrace.league.entry import load_entry
from airrace.league.entry_remote import EntryFailed, EntryRemote, GuardedBus, meet_entry
from airrace.league.page import write_page
from airrace.league.sandbox import EntryLog, excess_of
from airrace.league.season import Limits, Season, make_legs
from airrace.math.random import NoiseSequence, derive, make_generator
from airrace.scenario import Scenario
from airrace.systems.types import ExplorerEvent
from airrace.track import Track, load_track
from airrace.track.generator import generate_track
from tests.league.entries import make_entry
from tests.league.seasons import make_season, result
from tests.worlds.sockets import drain

TRAP = "raise SystemExit('trap: run outside of the sandbox')\n"
# What our packages import, and what they would import if it were installed.
MODULES = "yaml", "numba", "pandas", "coverage", "bottleneck", "IPython", "lz4", "drake"


def test_entries_named_as_modules_are_not_run(tmp_path):
    """In the folder in which the league is called."""
    for name in MODULES:
        make_entry(tmp_path / name, __init__=TRAP)
    make_entry(tmp_path / "herons")
    done = subprocess.run(
        [sys.executable, "-m", "airrace", "league", "check", "herons", "--no-flight"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": ""},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0 and "accepted" in done.stdout, done.stderr


def test_settings_of_numba_in_the_working_folder_are_refused(tmp_path, monkeypatch, capsys):
    """They say from where machine code is loaded: from the folder of an entry, for example."""
    (make_entry(tmp_path / "herons") / ".numba_config.yaml").write_text("cache_dir: code\n")
    monkeypatch.chdir(tmp_path / "herons")
    assert main(["league", "check", ".", "--no-flight"]) == 2
    assert "The file .numba_config.yaml in this folder" in capsys.readouterr().err


SPACE = 2**12  # in the place of 2^31, which a core tries in 40 s
SECRET = "nobody can guess this"


def seed_of(noise):
    """The seed whose noise an entry has seen in its state estimate, (12, 5), or None."""
    for seed in range(SPACE):
        if np.array_equal(make_generator(seed, "state_estimate").standard_normal((12, 5)), noise):
            return seed
    return None


def seen(leg):
    """What an entry finds of the noise of a race: no estimate is exact, but here it is."""
    sequence = NoiseSequence(leg.seed, "state_estimate", 5)
    return np.array([sequence[i] for i in range(12)])


def test_noise_does_not_give_the_seed_away(monkeypatch):
    season = Season(name="s", levels=[3], tracks=2, gates=8, seed_file="s")
    for leg in make_legs(season, SECRET):
        assert leg.seed > 2**128 and seed_of(seen(leg)) is None
    # Had it been found, the track would not follow from it.
    monkeypatch.setattr(season_module, "derive", lambda *words: derive(*words) % SPACE)
    leg = make_legs(season, SECRET)[0]
    assert seed_of(seen(leg)) == leg.seed
    track = load_yaml(Track, data=leg.track)
    assert generate_track(leg.seed, 8).gates[1].left_pylon != track.gates[1].left_pylon


# All that a terminal obeys, that turns the direction of writing or is not seen, and markup.
CONTROLS = "".join(map(chr, [*range(32), *range(127, 160), 0xAD, *range(0x200B, 0x2010)]))
HOSTILE = (
    f"{CONTROLS}\u2028\u202a\u202e\u2066\u2069\ufeff\x1b]52;c;ZWNobw==\x07\x1b[2J"
    "[/nope][red]<script>alert(1)</script>&lt;'\"{{ 1 }}"
)


def check_shown(text):
    """Nothing is obeyed, and markup is there as it was written."""
    assert text.replace("\n", "").isprintable(), ascii(text)


def said_by(capsys):
    """What was written to the terminal since the last time, in one piece."""
    return "".join(capsys.readouterr())


def test_bad_input_is_shown_and_not_obeyed(capsys):
    def fail():
        raise UserError(f"There is no '{HOSTILE}'.")

    assert exit_code(fail) == 2
    err = said_by(capsys)
    check_shown(err)
    assert "[/nope][red]<script>" in err


def test_what_an_entry_writes_and_sends_is_shown_and_not_obeyed(ends):
    reader, writer = os.pipe()
    log = EntryLog(open(reader, "rb"))
    line = HOSTILE.replace("\n", "").encode()
    with open(writer, "wb") as file:
        file.write(line + b"\n" + MARK.encode() + b"read " + line + b"\n")
    log.wait()
    bus = GuardedBus(ends[0])
    SocketBus(ends[1]).publish("\x1b[2J\u202e[/nope]", b"")
    drain(bus)
    for text in (*log.lines, *log.attempts, bus.violation):
        check_shown(text)
    codec = field_codec(ExplorerEvent, lcmt_explorer_event)
    check_shown(codec.decode(codec.encode(ExplorerEvent(0.0, "HOVER", HOSTILE))).reason)


def test_names_that_are_not_seen_are_refused(tmp_path):
    for name in ("\x1b[2J", "a\u202eb", "a\u200bb"):
        text = f"team: {json.dumps(name)}\n"
        with pytest.raises(UserError, match="1 to 60 characters that are seen"):
            load_entry(make_entry(tmp_path / "herons", text))
        with pytest.raises(ValueError, match="not seen"):
            dc.replace(load_track("hexagon"), name=name).check()


def test_a_season_with_hostile_names_is_shown(tmp_path, capsys):
    """As its teams chose them, since they are no harm as text."""
    team = printable(HOSTILE)
    reason = f"the entry was stopped by an error: {team}"
    league = make_season(tmp_path / "out", {"a": [result((10.0,))], "b": [result((), reason)]})
    for line in league["settings"]["entries"]:
        line["team"] = "[/nope]" + team
    print_ranking(league, tmp_path)
    console = Console(file=io.StringIO())
    print_line(console, words_of(league["flights"][1] | {"result": result((), HOSTILE)}))
    for text in (said_by(capsys), console.file.getvalue()):
        check_shown(text)
        assert "[/no" in text
    page = write_page(tmp_path, league).read_text()
    check_shown(page)
    assert "<script>alert" not in page and "&lt;script&gt;alert" in page


class Process:
    """In the place of an EntryProcess that runs."""

    def poll(self):
        return None

    def excess(self):
        return None

    def cpu_time(self):
        return 0.0


def speaking(end, says):
    """Starts an entry that sends heartbeats of the phase that says() returns, until it is None."""

    def speak():
        endpoint = Endpoint(AUTONOMY, (), SocketBus(end))
        while phase := says():
            endpoint.send_heartbeat(phase, 0.0)
            endpoint.wait(0.01)
            endpoint.drain()

    thread = threading.Thread(target=speak, daemon=True)
    thread.start()
    return thread


@pytest.mark.parametrize("first", [phases.COMPILING, phases.WAITING])
def test_who_only_compiles_is_out(ends, first):
    """Before it has met the simulation, or after that."""
    now = [first]
    thread = speaking(ends[1], lambda: now[0])
    try:
        with pytest.raises(EntryFailed, match="was not ready to race within 0.8 s"):
            remote = meet_entry(Scenario(), GuardedBus(ends[0]), Process(), Limits(start_wall=0.8))
            now[0] = phases.COMPILING
            remote._meet()
    finally:
        now[0] = None
        thread.join()


class Waits:
    """In the place of an Exchange whose other side takes its time."""

    def __init__(self, seconds, waiting=0):
        self.seconds, self.waiting = seconds, waiting

    def send(self, context):
        pass

    def receive(self, context, stop):
        end = time.monotonic() + self.seconds
        while time.monotonic() < end:
            if stop():
                return True
            time.sleep(0.01)
        return False


def steps(ends, exchange, **limits):
    """What three steps of an entry come to."""
    bus = GuardedBus(ends[0])
    start = types.SimpleNamespace(process=Process())
    remote = EntryRemote((), Endpoint(SIMULATION, (), bus), bus, start, Limits(**limits))
    remote._exchange = exchange
    return [remote._step(None) for _ in range(3)]


def test_neither_a_step_nor_all_of_them_take_for_ever(ends):
    """Whatever is sent meanwhile: it is the simulation that counts."""
    late = "the entry did not answer within 0.1 s"
    assert steps(ends, Waits(30.0), step_wall=0.1) == [late] * 3
    slow = "the entry took more than 0.25 s for all steps"
    assert steps(ends, Waits(0.2), race_wall=0.25) == [None, slow, slow]


def test_messages_of_no_step_are_not_kept_without_an_end(ends):
    broken = "the entry broke the rules: it sent messages that belong to no step"
    assert steps(ends, Waits(0.0, waiting=2000)) == [broken] * 3


def test_threads_and_files_are_counted():
    """Those of this process, which is in no sandbox."""
    assert excess_of(os.getpid(), Limits(threads=10**6, files=10**9)) is None
    assert excess_of(os.getpid(), Limits(threads=0)) == "it has more than 0 threads"
    many = excess_of(os.getpid(), Limits(threads=10**6, files=0))
    assert many == "it has more than 0 files in /tmp"
