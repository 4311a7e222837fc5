import json
import re
import subprocess
import sys

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


def test_the_logging_of_the_program_is_left_as_it_is():
    code = (
        "import logging, airrace.recording.topics; print(logging.root.handlers, logging.root.level)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "[] 30\n", done.stderr
