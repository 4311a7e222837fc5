"""Markers' modules, the grass texture, haze and sky."""

import numpy as np
import pytest

from airrace.rendering.scene.textures import grass_detail, haze, marker_modules, sky_color


def test_marker_has_a_black_frame():
    modules = marker_modules(7)
    assert modules.shape == (7, 7)
    assert modules[1:-1, 1:-1].any()
    modules = modules.copy()
    modules[1:-1, 1:-1] = False
    assert not modules.any()


def test_grass_continues_over_its_borders():
    grass = grass_detail().astype(float)
    inside = np.abs(np.diff(grass, axis=0)).mean()
    across = np.abs(grass[0] - grass[-1]).mean()
    assert across == pytest.approx(inside, rel=0.2)
    assert grass.mean() == pytest.approx(128, abs=3)
    assert grass.std() > 30


def test_shared_pictures_cannot_be_changed():
    with pytest.raises(ValueError):
        grass_detail()[0, 0] = 0


def test_haze_grows_with_distance_and_sky_is_paler_below():
    veil = haze(np.array([0.0, 10.0, 100.0, 1e6]))
    assert veil[0] == 0 and np.all(np.diff(veil) > 0) and veil[-1] < 1
    low, high = sky_color(np.array([0.0, 1.0]))
    assert low.sum() > high.sum()
