"""Where the page's camera is: above the track, behind the drone, or in it."""

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from pydrake.systems.framework import LeafSystem

from airrace.rendering.imaging.motion_blur import pose_of
from airrace.vehicle.state import as_plant_state
from airrace.visualization.paths import HERE

OVERVIEW, CHASE, ONBOARD = "overview", "chase", "onboard"
# The buttons of the page, and the keys that click them.
BUTTONS = {
    OVERVIEW: ("Overview (O)", "KeyO"),
    CHASE: ("Chase (C)", "KeyC"),
    ONBOARD: ("On board (B)", "KeyB"),
}
_BEHIND, _ABOVE = 5.0, 1.8  # m
_PERIOD = 1 / 30  # s, between two poses
_LAG = 0.5  # s, of the chasing camera's turns
_AHEAD = 10.0  # m


class ViewDirector(LeafSystem):
    """Moves the page's camera to the view whose button was clicked last.

    .. pydrake_system::

        name: ViewDirector
        input_ports:
        - truth.state

    ``truth.state`` is the plant's floating-body state (13). From above, the camera
    is the mouse's. On board it looks where the drone's looks, but with a level
    horizon.
    """

    def __init__(
        self,
        *,
        meshcat: Meshcat,
        overview: tuple[np.ndarray, np.ndarray],
        body_path: str,
        X_BC: RigidTransform,
    ):
        """Constructs the director, and the buttons.

        Args:
            meshcat: of the page.
            overview: from where to see all, see overview().
            body_path: where the drone is drawn.
            X_BC: pose of the drone's camera.
        """
        LeafSystem.__init__(self)
        self._meshcat = meshcat
        self._overview, self._body_path, self._X_BC = overview, body_path, X_BC
        self._share = 1.0 - np.exp(-_PERIOD / _LAG)
        self._clicks = {}
        for view, (button, key) in BUTTONS.items():
            meshcat.AddButton(button, key)
            self._clicks[view] = 0
        self._view = OVERVIEW  # see PathVisualizer
        self._forward = None  # level and lagging behind the drone's
        self._state = self.DeclareVectorInputPort("truth.state", 13)
        self.DeclarePeriodicPublishEvent(_PERIOD, 0.0, self._direct)
        self.DeclareForcedPublishEvent(self._direct)

    def _direct(self, context):
        for view, (button, _) in BUTTONS.items():
            clicks = self._meshcat.GetButtonClicks(button)
            if clicks != self._clicks[view]:
                self._clicks[view] = clicks
                self.show(view)
        X_WB = pose_of(as_plant_state(self._state.Eval(context)))
        if self._view == CHASE:
            self._meshcat.SetCameraPose(*self._chase(X_WB))
        elif self._view == ONBOARD:
            X_WC = X_WB @ self._X_BC
            ahead = X_WC @ np.array([0.0, 0.0, _AHEAD])
            self._meshcat.SetCameraPose(X_WC.translation().copy(), ahead)

    def _chase(self, X_WB):
        forward = X_WB.rotation().matrix()[:, 0] * [1.0, 1.0, 0.0]
        if self._forward is None:
            self._forward = forward
        self._forward = self._forward + self._share * (forward - self._forward)
        p_WB = X_WB.translation()
        return p_WB - _BEHIND * self._forward + [0.0, 0.0, _ABOVE], p_WB.copy()

    def show(self, view: str) -> None:
        """Changes to a view, one of the keys of BUTTONS."""
        self._view = view
        self._forward = None
        if view == OVERVIEW:
            self._meshcat.SetCameraPose(*self._overview)
        # From near, the ball around the drone only hides it; from inside, so does the hull.
        self._meshcat.SetProperty(HERE, "visible", view == OVERVIEW)
        self._meshcat.SetProperty(self._body_path, "visible", view != ONBOARD)

    def end(self) -> None:
        """Leaves the drone; a view of all of the track stays as it is."""
        if self._view != OVERVIEW:
            self.show(OVERVIEW)
