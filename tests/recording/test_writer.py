import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory

from airrace.common.errors import UserError
from airrace.recording import foxglove_messages
from airrace.recording.topics import TOPICS
from airrace.recording.writer import RaceLog


@pytest.fixture
def path(tmp_path):
    return tmp_path / "race.mcap"


def write_line(log, time):
    log.write("/explorer", time, foxglove_messages.log(time, "HOVER", f"at {time}"))


def test_any_reader_understands_it(path):
    log = RaceLog(path)
    log.attach("track.yaml", "name: x")
    write_line(log, 1.25)
    log.write("/referee/crossings", 2.0, {"time": 2.0, "gate": 1})
    log.close()
    log.close()
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        rows = list(reader.iter_decoded_messages(topics=["/explorer"]))
        ((schema, channel, message, line),) = rows
        assert (schema.name, schema.encoding) == ("foxglove.Log", "protobuf")
        assert channel.topic == "/explorer" and message.log_time == 1_250_000_000
        assert (line.name, line.message) == ("HOVER", "at 1.25")
        assert [(a.name, a.data) for a in reader.iter_attachments()] == [("track.yaml", b"name: x")]
        ((schema, channel, message),) = reader.iter_messages(topics=["/referee/crossings"])
        assert schema.encoding == "jsonschema" and channel.message_encoding == "json"
        assert schema.name == "airrace.GateCrossing"


def test_every_topic_has_a_schema(path):
    log = RaceLog(path)
    schemas = {topic: channel.schema() for topic, channel in log._channels.items()}
    log.close()
    for name, channel in TOPICS.items():
        if isinstance(channel, dict):
            assert channel["title"].startswith("airrace.") and channel["properties"]
        else:
            assert schemas[name].name == f"foxglove.{channel.__name__.removesuffix('Channel')}"


def test_what_was_flushed_can_be_read_while_it_is_open(path):
    log = RaceLog(path)
    write_line(log, 1.0)
    log.flush()
    write_line(log, 2.0)
    with open(path, "rb") as file:
        times = []
        with pytest.raises(Exception):
            for _, _, message in NonSeekingReader(file).iter_messages(log_time_order=False):
                times.append(message.log_time)
    assert times == [1_000_000_000]
    log.close()


def test_two_logs_do_not_mix(tmp_path):
    logs = [RaceLog(tmp_path / f"{name}.mcap") for name in "ab"]
    for log in logs:
        write_line(log, 1.0)
    for log in logs:
        log.close()
    for name in "ab":
        with open(tmp_path / f"{name}.mcap", "rb") as file:
            assert len(list(make_reader(file).iter_messages())) == 1


def test_a_file_that_cannot_be_written():
    path = Path("/none/race.mcap")
    with pytest.raises(UserError, match=f"{path} cannot be written .*--record none"):
        RaceLog(path)


FULL = """
import shutil
from pathlib import Path
from types import SimpleNamespace
from airrace.recording.foxglove_messages import log as line
from airrace.recording.writer import RaceLog
shutil.disk_usage = lambda path: SimpleNamespace(free=4096)
log = RaceLog(Path("/dev/full"))
for time in range(3):
    log.write("/explorer", float(time), line(float(time), "HOVER", ""))
    log.flush()
log.close()
"""


def test_a_disk_that_gets_full_is_one_line_and_the_race_goes_on():
    done = subprocess.run([sys.executable, "-c", FULL], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (
        0,
        "airrace: /dev/full cannot be written any more (the disk is full): the race goes on, and "
        "is recorded up to here.\n",
    )
