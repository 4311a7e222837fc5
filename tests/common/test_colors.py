import numpy as np
import pytest

from airrace.common.colors import SPEED_STOPS, rgb, speed_colors

# Who does not see red from green sees this of linear RGB: Machado, Oliveira, Fernandes, "A
# physiologically-based model for simulation of color vision deficiency", IEEE TVCG 15 (2009).
DEUTERANOPIA = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]]
)


def linear(colors):
    return np.where(colors <= 0.04045, colors / 12.92, ((colors + 0.055) / 1.055) ** 2.4)


def test_ends_and_stops():
    speeds = np.linspace(0.0, 15.0, len(SPEED_STOPS))
    stops = [rgb(stop) for stop in SPEED_STOPS]
    np.testing.assert_allclose(speed_colors(speeds, 15.0), stops, atol=1e-12)
    np.testing.assert_allclose(speed_colors([-1.0, 99.0], 15.0), [stops[0], stops[-1]], atol=1e-12)


def test_the_faster_the_lighter_so_that_it_can_be_read_in_grey():
    luminance = linear(speed_colors(np.linspace(0.0, 1.0, 50), 1.0)) @ [0.2126, 0.7152, 0.0722]
    assert np.all(np.diff(luminance) > 0.0)
    assert luminance[-1] > 3.5 * luminance[0]


def test_colour_blind_eyes_tell_slow_from_fast():
    seen = linear(speed_colors([0.0, 0.5, 1.0], 1.0)) @ DEUTERANOPIA.T
    yellow_minus_blue = seen[:, :2].mean(axis=1) - seen[:, 2]
    assert np.all(np.diff(yellow_minus_blue) > 0.15)


@pytest.mark.parametrize("paper", [1.0, 0.017])  # white, and the dark theme's
def test_every_colour_can_be_seen_on_white_and_on_dark_paper(paper):
    luminance = linear(speed_colors(np.linspace(0.0, 1.0, 50), 1.0)) @ [0.2126, 0.7152, 0.0722]
    high, low = np.maximum(luminance, paper), np.minimum(luminance, paper)
    assert np.min((high + 0.05) / (low + 0.05)) > 1.85
