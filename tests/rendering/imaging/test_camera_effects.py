"""The chain of shutter, lens and sensor."""

import dataclasses as dc

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from airrace.common.immutable import read_only
from airrace.rendering.imaging.camera_effects import CameraEffects, ImagingChain
from airrace.rendering.planar.renderer import PlanarRenderer
from tests.worlds.pictures import CAMERA_INFO, new_picture, one_gate, take_picture

X_WB = RigidTransform(RollPitchYaw(0.05, 0.1, 0.2), [6.0, 0.0, 5.0])
W, V = np.array([0.4, -0.8, 1.5]), np.array([12.0, 4.0, -2.0])
EVERYTHING = CameraEffects(
    shutter=0.006,
    gain=0.9,
    vignetting=0.3,
    read_noise=2.0,
    shot_noise=0.05,
    distortion=(-0.2, 0.05, 0.001, 0.0, 0.0),
)


def take(effects, frame=0, seed=0):
    info = dc.replace(CAMERA_INFO, D=read_only(effects.distortion))
    chain = ImagingChain(effects=effects, camera_info=info, seed=seed)
    picture = new_picture()
    take_picture(
        chain, PlanarRenderer(one_gate(), chain.pinhole).render, X_WB, W, V, frame, picture
    )
    assert np.all(picture[..., 3] == 255)
    return picture


def test_no_effects_draw_the_renderers_picture():
    ideal = new_picture()
    PlanarRenderer(one_gate(), CAMERA_INFO).render(X_WB @ CAMERA_INFO.X_BC, ideal)
    assert np.array_equal(take(CameraEffects()), ideal)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["shutter", "gain", "vignetting", "read_noise", "shot_noise", "distortion"]
)
def test_each_effect_shows_alone(name):
    one = dc.replace(CameraEffects(), **{name: getattr(EVERYTHING, name)})
    difference = np.abs(take(one).astype(int) - take(CameraEffects()))
    assert difference.max() > 3


@pytest.mark.slow
def test_pictures_are_functions_of_sample_frame_and_seed():
    picture = take(EVERYTHING, 3, 1)
    assert np.array_equal(picture, take(EVERYTHING, 3, 1))
    assert not np.array_equal(picture, take(EVERYTHING, 4, 1))
    assert not np.array_equal(picture, take(EVERYTHING, 3, 2))


@pytest.mark.slow
def test_a_chain_remembers_nothing():
    info = dc.replace(CAMERA_INFO, D=read_only(EVERYTHING.distortion))
    chain = ImagingChain(effects=EVERYTHING, camera_info=info, seed=0)
    render = PlanarRenderer(one_gate(), chain.pinhole).render
    picture = new_picture()
    for X, frame in ((RigidTransform([0, 0, 9.0]), 7), (X_WB, 2)):
        take_picture(chain, render, X, W, V, frame, picture)
    assert np.array_equal(picture, take(EVERYTHING, 2))
