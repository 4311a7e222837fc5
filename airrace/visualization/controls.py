"""A pause button and a slider of the race's speed, on the page."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator

if TYPE_CHECKING:
    from airrace.visualization.views import ViewDirector

PAUSE = "Pause / go on (space)"
SPEED = "Speed (x real time, 0 = free)"
_MOST, _STEP = 10.0, 0.25
_NAP = 0.05  # s


class RaceControls:
    """Steers a Simulator as the buttons of a page say.

    Only how fast a race is simulated changes, never what happens in it.
    """

    def __init__(
        self, meshcat: Meshcat, simulator: Simulator, director: "ViewDirector | None" = None
    ):
        """Adds the button and the slider.

        Args:
            meshcat: of the page.
            simulator: of the race.
            director: the ViewDirector in it, which goes on while the race stands
                still; None if there is none.
        """
        self._meshcat = meshcat
        self._simulator = simulator
        self._director = director
        meshcat.AddButton(PAUSE, "Space")
        if SPEED in meshcat.GetSliderNames():  # of a race before on the same page
            meshcat.DeleteSlider(SPEED)
        rate = simulator.get_target_realtime_rate()
        self._rate = meshcat.AddSlider(SPEED, 0.0, max(_MOST, rate), _STEP, rate)

    def steer(self, interrupted: Callable[[], bool] = lambda: False) -> None:
        """Does what was asked for on the page; while the race is paused, waits.

        Args:
            interrupted: whether to give up waiting.
        """
        paused = False
        while self._meshcat.GetButtonClicks(PAUSE) % 2 == 1 and not interrupted():
            paused = True
            if self._director is not None:
                context = self._director.GetMyContextFromRoot(self._simulator.get_context())
                self._director.ForcedPublish(context)
            time.sleep(_NAP)
        rate = self._meshcat.GetSliderValue(SPEED)
        if rate != self._rate:
            self._rate = rate
            self._simulator.set_target_realtime_rate(rate)
        elif not paused:
            return
        # It would hurry to make up for the time before.
        self._simulator.ResetStatistics()
