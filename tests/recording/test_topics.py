import json
import re

from airrace.common.resources import models_path
from airrace.recording.topics import TOPICS


def test_the_layout_shows_topics_that_there_are():
    text = (models_path() / "foxglove" / "airrace.json").read_text()
    layout = json.loads(text)
    named = set(re.findall(r'"(/[a-z/]+)', text))
    assert named <= set(TOPICS) and len(named) > 10

    def panels(node):
        if isinstance(node, str):
            return [node]
        return [*panels(node["first"]), *panels(node["second"])]

    assert sorted(panels(layout["layout"])) == sorted(layout["configById"])
