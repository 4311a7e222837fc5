"""A detector of your own. It flies as it is: change _calc_detections() and race again.

    airrace race --track hexagon --laps 1 --scenario_text '{systems: {aruco_detector: "NAME:make"}}'

It searches the whole picture with OpenCV and solves each marker's pose on its own. The
detector that airrace flies unless told otherwise is many times more accurate.
"""

import cv2
import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import LeafSystem

from airrace.systems.types import Detection, Detections
from airrace.track import MARKER_SIZE

H = MARKER_SIZE / 2  # m
# The corners of a marker in its own frame M: top left first, then clockwise.
CORNERS = np.array([[-H, H, 0], [H, H, 0], [H, -H, 0], [-H, -H, 0.0]])
MAX_ID = 4 * 20 - 1  # gate n has the markers 4 n to 4 n + 3; there are 20 gates at most
LEAST_DIAGONAL = 25.0  # pixels: the pose of a smaller marker is too uncertain


class MyDetector(LeafSystem):
    """Finds markers in the camera's pictures.

    .. pydrake_system::

        name: MyDetector
        input_ports:
        - camera_view
        - camera_image_time
        - camera_info
        output_ports:
        - detections
    """

    def __init__(self):
        """Declares the ports; their names say what they are connected to."""
        LeafSystem.__init__(self)
        self._view = self.DeclareAbstractInputPort("camera_view", Value[object]())
        self._time = self.DeclareVectorInputPort("camera_image_time", 1)
        self._info = self.DeclareAbstractInputPort("camera_info", Value[object]())
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
        self._detector = cv2.aruco.ArucoDetector(dictionary, parameters)
        # It depends on the inputs alone. So Drake's cache calls _calc_detections() once a
        # picture, however many ask for it; without the ticket, again whenever time goes on.
        self.DeclareAbstractOutputPort(
            "detections",
            lambda: Value[object](Detections()),
            self._calc_detections,
            {self.all_input_ports_ticket()},
        )

    def _calc_detections(self, context, output):
        picture = self._view.Eval(context).whole()  # grey levels, (height, width)
        camera = self._info.Eval(context)
        quads, ids, _ = self._detector.detectMarkers(picture)
        found = []
        for id, quad in zip([] if ids is None else np.ravel(ids).tolist(), quads):
            corners = quad.reshape(4, 2).astype(float)
            if id > MAX_ID or np.linalg.norm(corners[0] - corners[2]) < LEAST_DIAGONAL:
                continue
            solved, rotation, p_CM = cv2.solvePnP(
                CORNERS, corners, camera.K, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
            )
            if solved:
                X_CM = RigidTransform(RotationMatrix(cv2.Rodrigues(rotation)[0]), p_CM.ravel())
                found.append(Detection(id, corners, X_CM, reprojection_error=0.5))
        # The mapper needs the time of the picture: at 10 m/s, 10 ms are 10 cm.
        time = self._time.Eval(context)[0]
        output.set_value(Detections(time=time, markers=tuple(sorted(found, key=lambda m: m.id))))


def make(scenario):
    """Returns the system; called once before a race, with everything that is known of it."""
    return MyDetector()
