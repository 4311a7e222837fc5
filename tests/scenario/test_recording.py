import pytest

from airrace.common.errors import UserError
from airrace.scenario import load_scenario


@pytest.mark.parametrize(
    "text, words",
    [
        ("{content: all}", "recording.content must be one of none, light, full, not 'all'"),
        ("{image_rate: 31}", "recording.image_rate must be at most camera.fps, 30 Hz, not 31"),
        ("{image_rate: 0}", "recording.image_rate must be at least 0.1"),
        ("{state_rate: .inf}", "recording.state_rate must be a finite number"),
        ("{jpeg_quality: 101}", "recording.jpeg_quality must be at most 100"),
    ],
)
def test_bad_values(text, words):
    with pytest.raises(UserError, match=words):
        load_scenario(scenario_text=f"recording: {text}").check()


def test_without_pictures_their_rate_does_not_matter():
    load_scenario(
        scenario_text="{recording: {content: light}, camera: {fps: 2}, perception: {latency: 0.01}}"
    ).check()
