import base64
import json
import threading

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from airrace.visualization import race_record
from airrace.visualization.race_record import CROSSINGS, EVENTS, FRAME, RaceRecord, script_json
from tests.worlds.cases import guarded


def frames_of(batch):
    data = base64.b64decode(batch.get("frames", ""))
    return np.frombuffer(data, "<f4").reshape(-1, len(FRAME))


def frame(time):
    return [time, *range(1, len(FRAME))]


def test_a_reader_gets_what_is_new():
    record, cursor = RaceRecord(), {}
    assert record.since(cursor)[0] == {}
    record.add_frame(frame(0.5))
    record.add(EVENTS, 0.5, text="a")
    batch, cursor = record.since(cursor)
    np.testing.assert_array_equal(frames_of(batch), [frame(0.5)])
    assert batch[EVENTS] == [{"t": 0.5, "text": "a"}]
    record.add(CROSSINGS, 1.0, gate=1, lap=1)
    result = {"finished": True, "dnf_reason": None, "exploration": {"time_s": 1.5}}
    record.end(2.0, result)
    batch, cursor = record.since(cursor)
    over = {"t": 2.0, "finished": True, "reason": None, "exploration": 1.5}
    assert batch == {CROSSINGS: [{"t": 1.0, "gate": 1, "lap": 1}], "over": over}
    assert record.since(cursor)[0] == {}


@given(st.lists(st.sampled_from(["frame", "event", "read"]), max_size=40))
def test_all_batches_together_are_the_whole(steps):
    record, cursor, batches = RaceRecord(), {}, []
    for k, step in enumerate([*steps, "read"]):
        if step == "frame":
            record.add_frame(frame(k))
        elif step == "event":
            record.add(EVENTS, float(k), text=str(k))
        else:
            batch, cursor = record.since(cursor)
            batches.append(batch)
    whole = record.whole()
    np.testing.assert_array_equal(
        np.concatenate([frames_of(batch) for batch in batches]), frames_of(whole)
    )
    assert sum((batch.get(EVENTS, []) for batch in batches), []) == whole.get(EVENTS, [])


def test_who_is_slow_gets_only_the_newest_pictures():
    record = RaceRecord()
    for k in range(9):
        record.add_picture(float(k), b"x", [])
    batch, cursor = record.since()
    assert [picture["t"] for picture in batch["pictures"]] == [6.0, 7.0, 8.0]
    assert record.since(cursor)[0] == {}
    assert len(record.whole()["pictures"]) == 9


def test_pictures_thin_out_evenly_when_they_get_too_large(monkeypatch):
    monkeypatch.setattr(race_record, "_PICTURE_BYTES", 100_000)
    record = RaceRecord()
    for k in range(1000):
        record.add_picture(0.5 * k, bytes(750), [])  # 1000 characters
    pictures = record.whole()["pictures"]
    assert sum(len(picture["jpeg"]) for picture in pictures) <= 101_000
    times = np.array([picture["t"] for picture in pictures])
    assert len(times) > 45 and times[-1] == 499.5 and np.diff(times).max() < 12.0


def test_a_reader_in_another_thread_misses_nothing():
    record, seen, done = RaceRecord(), [], threading.Event()

    def read():
        cursor = {}
        while not done.is_set() or record.since(cursor)[0]:
            batch, cursor = record.since(cursor)
            seen.extend(frames_of(batch)[:, 0])

    thread = threading.Thread(target=read)
    thread.start()
    for k in range(3000):
        record.add_frame(frame(k))
    done.set()
    thread.join()
    np.testing.assert_array_equal(seen, np.arange(3000))


@guarded
@given(st.text())
def test_nothing_ends_a_script_element(text):
    made = script_json({"text": text})
    assert "<" not in made and json.loads(made) == {"text": text}
