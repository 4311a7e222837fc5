import asyncio
import json

import pytest
import tornado.httpclient
import tornado.websocket

from airrace.common.errors import UserError
from airrace.recording.foxglove_messages import log
from airrace.recording.foxglove_server import FoxgloveServer
from airrace.recording.topics import TOPICS
from airrace.recording.writer import RaceLog

# Of Foxglove's protocol, https://github.com/foxglove/ws-protocol: the first byte of what is
# sent in binary, and how much stands before a message: that, the subscription and the time.
MESSAGE_DATA, HEADER = 1, 1 + 4 + 8


@pytest.fixture
def server():
    with FoxgloveServer(port=0) as server:
        yield server


def talk(server, conversation):
    """Runs a conversation, a coroutine of a connected client; returns what it returns."""

    async def run():
        request = tornado.httpclient.HTTPRequest(server.url)
        protocols = ["foxglove.sdk.v1"]
        client = await tornado.websocket.websocket_connect(request, subprotocols=protocols)
        try:
            return await asyncio.wait_for(conversation(client), 20)
        finally:
            client.close()
            while await client.read_message() is not None:  # until it is
                pass

    return asyncio.run(run())


async def answer(client, op):
    """Returns the next message that is JSON and does something."""
    while True:
        message = await client.read_message()
        if isinstance(message, str) and (message := json.loads(message))["op"] == op:
            return message


async def advertised(client, count):
    channels = {}
    while len(channels) < count:
        for channel in (await answer(client, "advertise"))["channels"]:
            channels[channel["topic"]] = channel
    return channels


async def subscribe(client, channel):
    subscriptions = [{"id": 7, "channelId": channel["id"]}]
    await client.write_message(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))


async def data(client):
    while True:
        message = await client.read_message()
        if isinstance(message, bytes) and message[0] == MESSAGE_DATA:
            return message


def test_it_offers_the_topics_of_the_file(server):
    async def conversation(client):
        return await advertised(client, len(TOPICS))

    assert set(talk(server, conversation)) == set(TOPICS)


def test_what_is_written_is_sent_and_the_newest_again_to_who_comes_late(server, tmp_path):
    race = RaceLog(tmp_path / "race.mcap", server)
    race.write("/explorer", 1.5, log(1.5, "HOVER", "words of the past"))

    async def conversation(client):
        channels = await advertised(client, len(TOPICS))
        await subscribe(client, channels["/explorer"])
        await asyncio.sleep(0.5)
        race.write("/referee", 2.0, log(2.0, "gate", "something else"))
        late = await data(client)
        race.write("/explorer", 2.5, log(2.5, "HOVER", "words of the present"))
        return late, await data(client)

    late, present = talk(server, conversation)
    assert b"words of the past" in late
    assert int.from_bytes(late[5:HEADER], "little") == 1_500_000_000
    assert b"words of the present" in present
    race.close()


def test_a_file_is_the_same_with_and_without_it(server, tmp_path):
    for name, live in (("a", None), ("b", server)):
        race = RaceLog(tmp_path / name, live)
        race.write("/explorer", 1.5, log(1.5, "HOVER", "words"))
        race.close()
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_it_serves_without_a_file(server):
    race = RaceLog(None, server)
    race.attach("a", "text")
    race.write("/explorer", 1.5, log(1.5, "HOVER", "words"))
    race.flush()
    race.close()


def test_a_port_that_is_taken(server):
    port = int(server.url.rpartition(":")[2])
    with pytest.raises(UserError, match=f"at port {port} .*; close the other program"):
        FoxgloveServer(port)


def test_whatever_a_client_sends_the_terminal_stays_quiet(server, capfd, caplog):
    async def conversation(client):
        unknown = {"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99999}]}
        for message in (json.dumps(unknown), "[" * 1000, "no JSON", b"\xff" * 10):
            await client.write_message(message, binary=isinstance(message, bytes))
        return await advertised(client, len(TOPICS))

    talk(server, conversation)
    assert capfd.readouterr() == ("", "") and not caplog.records
