import base64
import json

import cv2
import numpy as np

from airrace.visualization.meshcat_page import HUD
from airrace.visualization.picture import FixedPicture, picture_gltf
from tests.visualization.meshcat_tools import transform


def test_a_picture_file_holds_the_picture():
    image = np.zeros((90, 160, 3), np.uint8)
    image[:, :80] = (255, 0, 0)
    gltf = json.loads(picture_gltf(image))
    jpeg = base64.b64decode(gltf["images"][0]["uri"].partition(",")[2])
    again = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert np.abs(again.astype(int) - image)[:, :70].max() < 30
    data = base64.b64decode(gltf["buffers"][0]["uri"].partition(",")[2])
    assert len(data) == gltf["buffers"][0]["byteLength"]
    points = np.frombuffer(data[:48], np.float32).reshape(4, 3)
    # y is up in the file, z on the page.
    on_page = np.column_stack([points[:, 0], -points[:, 2], points[:, 1]])
    np.testing.assert_allclose(on_page, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def test_pictures_cover_one_another_and_the_oldest_go(meshcat):
    picture = FixedPicture(meshcat, "test", left=-1.0, top=0.5, width=0.5)
    image = np.zeros((9, 16, 3), np.uint8)
    for _ in range(40):
        picture.show(image)
    assert not meshcat.HasPath(f"{HUD}/test/7")
    matrices = [transform(meshcat, f"{HUD}/test/{k}") for k in range(8, 40)]
    scales = [m[0] / 0.5 for m in matrices]
    assert np.all(np.diff(scales) < 0.0) and min(scales) > 0.01  # nearer, but not too near
    np.testing.assert_allclose([m[14] for m in matrices], -np.array(scales))
