"""Exposure, vignetting and noise are what their numbers say."""

import numpy as np
import pytest

from airrace.rendering.imaging.sensor import Sensor
from tests.worlds.pictures import CAMERA_INFO as INFO

CLEAN = dict(gain=1.0, vignetting=0.0, read_noise=0.0, shot_noise=0.0)


def expose(level, frame=0, seed=0, **kwargs):
    """Returns an evenly lit picture, RGBA."""
    image = np.full((INFO.height, INFO.width, 4), level, np.uint8)
    image[..., 3] = 255
    Sensor(camera_info=INFO, seed=seed, **{**CLEAN, **kwargs}).expose(image, frame)
    assert np.all(image[..., 3] == 255)
    return image


def test_nothing_to_do_does_nothing():
    assert np.all(expose(100)[..., :3] == 100)


@pytest.mark.parametrize("gain", [0.05, 0.3, 0.8, 1.3, 2.0, 3.9, 7.0, 10.0])
def test_gain(gain):
    for level in (20, 100):
        expected = min(level * gain, 255)
        assert np.abs(expose(level, gain=gain)[..., :3] - expected).max() < 1 + 0.01 * expected


def test_vignetting_follows_the_cosine_law():
    image = expose(250, vignetting=0.4)[..., 1].astype(float)
    middle = image[360, 640]
    assert middle == 250
    assert image[0, 0] / middle == pytest.approx(0.6, abs=0.01)
    diagonal = image[np.arange(720), np.round(np.arange(720) * 16 / 9).astype(int)]
    assert np.all(np.diff(diagonal[:360]) >= 0)
    assert np.abs(image - image[::-1, ::-1]).max() <= 2

    # 1 - V is in proportion to 1 - cos^4 of the angle off axis.
    def loss(u, v):
        tan2 = ((u - 640) ** 2 + (v - 360) ** 2) / INFO.K[0, 0] ** 2
        return 1 - (1 / (1 + tan2)) ** 2

    for u, v in ((640, 100), (200, 360), (1000, 600)):
        share = 0.4 * loss(u, v) / loss(0, 0)
        assert image[v, u] == pytest.approx(250 * (1 - share), abs=1.5)


@pytest.mark.parametrize(
    "read, shot", [(1.0, 0.0), (4.0, 0.0), (0.0, 0.15), (1.0, 0.02), (4.0, 0.15)]
)
@pytest.mark.parametrize("level", [40, 120, 210])
def test_variance_of_noise(read, shot, level):
    noise = expose(level, read_noise=read, shot_noise=shot)[..., :3].astype(float) - level
    # Rounding adds a little.
    variance = read**2 + shot * level + 1 / 12
    assert noise.var() == pytest.approx(variance, rel=0.03)
    assert abs(noise.mean()) < 0.02
    # It is white, and the same in all colours.
    assert np.array_equal(noise[..., 0], noise[..., 1])
    grey = noise[..., 0]
    for a, b in ((grey[1:], grey[:-1]), (grey[:, 1:], grey[:, :-1])):
        assert abs(np.mean(a * b)) < 0.01 * variance


def test_noise_is_a_function_of_frame_and_seed():
    noise = dict(read_noise=3.0)
    first = expose(100, 7, 5, **noise)
    assert np.array_equal(first, expose(100, 7, 5, **noise))
    sensor = Sensor(camera_info=INFO, seed=5, **{**CLEAN, **noise})
    for frame in (3, 7):  # whatever was exposed before
        image = np.full_like(first, 100)
        sensor.expose(image, frame)
    assert np.array_equal(image[..., :3], first[..., :3])
    for other in (expose(100, 8, 5, **noise), expose(100, 7, 6, **noise)):
        a, b = (x[..., 0].astype(float).ravel() - 100 for x in (first, other))
        assert abs(np.corrcoef(a, b)[0, 1]) < 0.01
