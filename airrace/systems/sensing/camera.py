"""The drone's camera."""

import math
import typing
from collections.abc import Iterable
from typing import Any

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.value import Value
from pydrake.geometry import QueryObject
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageGrey8U, ImageRgba8U

from airrace.rendering.imaging.camera_effects import ImagingChain
from airrace.rendering.imaging.motion_blur import MeanPicture, moved
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.seed import declare_seed
from airrace.systems.sensing.camera_view import CameraView
from airrace.systems.sensing.state_estimate import plant_lead
from airrace.vehicle.camera_info import CameraInfo
from airrace.vehicle.sensor_failures import CameraFailure, failure_at
from airrace.vehicle.state import STATE_SIZE, as_state

_NO_SEED = -1  # of the sample that is shown before the first


class Renderer(typing.Protocol):
    """What draws the pictures: a PlanarRenderer, a VtkRenderer or your own."""

    #: Whether render() takes the QueryObject of a SceneGraph as third argument.
    needs_query_object: bool

    def render(self, X_WC: RigidTransform, out: np.ndarray, *scene: Any) -> None:
        """Draws the world seen from X_WC into ``out``, uint8.

        That is RGBA, (h, w, 4), or grey levels, (h, w). ``scene`` is the
        QueryObject, or the shifts of the gates, (n, 2), if the Camera is told
        that gates move, or nothing.

        A renderer that can draw parts of pictures has a method expose(poses,
        X_WC, *scene), too: see PlanarRenderer.
        """


class Camera(LeafSystem):
    """Takes a picture at every frame period.

    .. pydrake_system::

        name: Camera
        input_ports:
        - state
        - geometry_query (only if the renderer needs it)
        - gate_shifts (only if gates move, and the renderer needs no geometry_query)
        - seed (may be left open)
        output_ports:
        - camera_image
        - camera_grey
        - camera_view
        - camera_image_time
        - camera_info

    ``state`` is the plant's floating-base state (13), see vehicle.State; ``gate_shifts``
    (2 n) is where the gates stand, see GateMover; ``seed``, of the noise: see SeedSource.

    The camera samples its inputs when a flight starts and then at all multiples of 1/fps.
    A picture shows the world from the sampled pose. There are three forms of it:
    ``camera_image`` (abstract, ImageRgba8U); ``camera_grey`` (abstract, ImageGrey8U), which
    is drawn several times as fast and equals, up to rounding, what OpenCV makes of the
    colours; and ``camera_view`` (abstract, CameraView), of which only the parts that are
    read are drawn. ``camera_image_time`` (vector, shape (1,)) is the time of the sample (s),
    the middle of the exposure. All appear ``latency`` after it, but for the first ones,
    which are there from the beginning. ``camera_info`` (abstract, CameraInfo) never changes.

    A MultibodyPlant with sampled output ports steps before the discrete updates of the
    same time, so its state is that of one plant step later then: switch them off
    (``SetUseSampledOutputPorts(False)``). Between its steps a discrete plant shows the
    state at the end of the step; the camera extrapolates back to the time of the sample.

    A picture is a function of the sample only, so Drake's cache keeps it until the next
    one: each form is drawn at most once, and never if nobody reads it. With a renderer
    that needs ``geometry_query`` this holds only if the scene does not change in between.
    The drone itself moves, so it must be invisible to that renderer: give its visuals no
    perception role.
    """

    def __init__(
        self,
        *,
        camera_info: CameraInfo,
        fps: float,
        renderer: Renderer,
        imaging: ImagingChain | None = None,
        latency: float = 0.0,
        moving_gates: int = 0,
        failures: Iterable[CameraFailure] = (),
        seed: int = 0,
        state_period: float = 0.0,
    ):
        """Constructs the camera.

        Args:
            camera_info: calibration and the camera's pose X_BC in the body.
            fps: pictures per second.
            renderer: draws the pictures; made for the same camera_info, or for
                ``imaging.pinhole``.
            imaging: turns what is drawn into what a real camera shows.
            latency: from a sample to its picture, less than 1/fps (s).
            moving_gates: how many gates there are, if they move, else 0.
            failures: when pictures are black.
            seed: of the noise, if the port is left open.
            state_period: of the plant's steps (s); 0 if its state is continuous.
        """
        LeafSystem.__init__(self)
        self._state_period = state_period
        self._failures = tuple(failures)
        self._info = camera_info
        self._fps = fps
        self._renderer = renderer
        self._imaging = imaging
        self._state = self.DeclareVectorInputPort("state", STATE_SIZE - 1)
        self._query = None
        if renderer.needs_query_object:
            self._query = self.DeclareAbstractInputPort("geometry_query", Value(QueryObject()))
        self._shifts = None
        if moving_gates and not renderer.needs_query_object:
            self._shifts = self.DeclareVectorInputPort("gate_shifts", 2 * moving_gates)
        self._seed = declare_seed(self, seed)

        # A sample is a vector of State, where gates that move are, and the seed. The one that the
        # outputs show is an abstract state: any discrete update would invalidate Drake's
        # cache of all discrete states, and the picture would be drawn anew.
        blank = np.zeros(STATE_SIZE + (0 if self._shifts is None else 2 * moving_gates) + 1)
        blank[-1] = _NO_SEED
        as_state(blank[:STATE_SIZE]).quaternion[0] = 1.0
        self._shown = self.DeclareAbstractState(Value[object](blank))
        # The periodic event at t = 0 happens only in the first step, after the
        # first publish; so the first sample is taken at initialization, too.
        self.DeclareInitializationUnrestrictedUpdateEvent(self._start)
        self.DeclareForcedUnrestrictedUpdateEvent(self._show_now)
        self._newest = None
        if latency == 0:
            self.DeclarePeriodicUnrestrictedUpdateEvent(1 / fps, 0.0, self._show_now)
        else:
            self._newest = self.DeclareDiscreteState(blank)
            self.DeclarePeriodicDiscreteUpdateEvent(1 / fps, 0.0, self._sample)
            self.DeclarePeriodicUnrestrictedUpdateEvent(1 / fps, latency, self._show_newest)

        ticket = {self.abstract_state_ticket(self._shown)}
        self.DeclareAbstractOutputPort(
            "camera_image",
            lambda: Value(ImageRgba8U(camera_info.width, camera_info.height)),
            self._calc_image,
            prerequisites_of_calc=ticket,
        )
        self.DeclareAbstractOutputPort(
            "camera_grey",
            lambda: Value(ImageGrey8U(camera_info.width, camera_info.height)),
            self._calc_grey,
            prerequisites_of_calc=ticket,
        )
        self._view = self.DeclareAbstractOutputPort(
            "camera_view", lambda: Value[object](), self._calc_view, prerequisites_of_calc=ticket
        )
        self.DeclareVectorOutputPort(
            "camera_image_time", 1, self._calc_time, prerequisites_of_calc=ticket
        )
        self.DeclareAbstractOutputPort(
            "camera_info",
            lambda: Value(camera_info),
            lambda context, output: output.set_value(camera_info),
            prerequisites_of_calc={self.nothing_ticket()},
        )

    def _sample_now(self, context: Context) -> np.ndarray:
        inputs = [self._state] if self._shifts is None else [self._state, self._shifts]
        values = [port.Eval(context) for port in inputs]
        return np.hstack([context.get_time(), *values, self._seed(context)])

    def _start(self, context, state):
        # A flight that goes on has a sample, and gets the next one when it is due.
        if context.get_time() == 0.0 or self._shown_sample(context)[-1] == _NO_SEED:
            self._show_now(context, state)
            if self._newest is not None:
                state.get_mutable_discrete_state(self._newest).set_value(self._sample_now(context))

    def _show_now(self, context, state):
        shown = state.get_mutable_abstract_state(int(self._shown))
        shown.set_value(self._sample_now(context))

    def _sample(self, context, discrete_state):
        discrete_state.set_value(self._newest, self._sample_now(context))

    def _show_newest(self, context, state):
        newest = context.get_discrete_state(self._newest).value().copy()
        state.get_mutable_abstract_state(int(self._shown)).set_value(newest)

    def _shown_sample(self, context: Context) -> np.ndarray:
        return context.get_abstract_state(int(self._shown)).get_value()

    def _calc_image(self, context, output):
        self._picture(context)(output.get_mutable_value().mutable_data)

    def _calc_grey(self, context, output):
        picture = output.get_mutable_value().mutable_data
        picture[..., 0] = self._view.Eval(context).whole()

    def _calc_view(self, context, output):
        view = CameraView((self._info.height, self._info.width), self._picture(context))
        if not hasattr(self._renderer, "expose"):
            view.whole()  # while the scene is there
        output.set_value(view)

    def _picture(self, context):
        """Returns what draws the picture: draw(out, boxes=None), see Exposure."""
        sample = self._shown_sample(context)
        time, q, p_WB, w_WB, v_WB = as_state(sample[:STATE_SIZE])
        if failure_at(self._failures, time) == "dark":
            return _draw_black
        # The plant's integrator lets the quaternion's norm drift a little.
        X_WB = RigidTransform(Quaternion(q / math.sqrt(q.dot(q))), p_WB)
        if self._state_period > 0.0:
            X_WB = moved(X_WB, w_WB, v_WB, -plant_lead(time, self._state_period))
        args = () if self._query is None else (self._query.Eval(context),)
        if self._shifts is not None:
            args = (sample[STATE_SIZE:-1].reshape(-1, 2),)

        def expose(poses, X_WC):
            if hasattr(self._renderer, "expose"):
                return self._renderer.expose(poses, X_WC, *args)
            return MeanPicture(lambda X_WC, out: self._renderer.render(X_WC, out, *args), poses)

        if self._imaging is None:
            X_WC = X_WB @ self._info.X_BC
            return expose([(1.0, X_WC)], X_WC).draw
        frame, seed = round(time * self._fps), int(sample[-1]) if sample[-1] >= 0 else None
        return self._imaging.picture(expose, X_WB, w_WB, v_WB, frame, seed).draw

    def _calc_time(self, context, output):
        output.SetAtIndex(0, self._shown_sample(context)[0])


def _draw_black(out: np.ndarray, boxes: np.ndarray | None = None) -> None:
    """Draws nothing into an array, (h, w) or RGBA (h, w, 4), whatever the boxes are."""
    out[:] = 0
    if out.ndim == 3:
        out[..., 3] = 255
