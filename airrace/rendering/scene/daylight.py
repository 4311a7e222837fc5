"""Lights and sky of the visualiser, as in the camera's pictures."""

import numpy as np

from airrace.rendering.scene.textures import HORIZON, ZENITH


def SetDaylight(meshcat) -> None:
    """Makes Meshcat, whose default is a dim studio, look like a fine day."""
    meshcat.SetProperty("/Lights/AmbientLight/<object>", "intensity", 2.0)
    meshcat.SetProperty("/Background/<object>", "top_color", list(np.array(ZENITH) / 255))
    meshcat.SetProperty("/Background/<object>", "bottom_color", list(np.array(HORIZON) / 255))
