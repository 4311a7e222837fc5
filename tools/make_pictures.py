"""Makes the README's pictures from a real run: python -m tools.make_pictures.

Flies one lap of student-airrace, opens its replay in a headless Chromium, and photographs it:
the whole track, and the lap from behind the drone. So they show what people see on their screens.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from PIL import Image
from rich.progress import track as progress

from airrace.common.errors import UserError, exit_code
from tests.visualization.browser import CHROMIUM, Browser

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "pictures"
_FPS, _SPEED = 10.0, 2.0  # frames a second, and seconds of the race a second
_STILL, _FILM = (1280, 720), (1120, 630)  # px, of the window
_FILM_WIDTH = 720  # px, of the film itself
_READY = "!!window.airrace && airrace.timeline.count > 0"


def fly(folder: Path):
    """Flies the race; returns its Run."""
    from airrace.analysis import load_run
    from airrace.diagrams.race import run_race
    from airrace.scenario import load_scenario

    scenario = load_scenario(scenario_text="{laps: 1}")
    with progress_bar("Flying") as take:
        run_race(scenario, folder, sinks=[take])
    return load_run(folder)


def progress_bar(what: str):
    """Returns a context manager of a sink of run_race() that shows a clock."""
    from rich.console import Console
    from rich.status import Status

    class Clock(Status):
        def __enter__(self):
            super().__enter__()
            return lambda event: self.update(f"{what}: {event.time:.0f} s simulated")

    return Clock(what, console=Console(stderr=True))


class Replay:
    """The replay of a run in a browser, while its ``with`` block lasts."""

    def __init__(self, run, folder: Path):
        """Args: run: see load_run(). folder: for the page."""
        from airrace.visualization.ghosts import make_ghosts, replay_page

        self._page = folder / "replay.html"
        self._page.write_text(replay_page(make_ghosts([run])), encoding="utf-8")
        self._browser = Browser(*_STILL)

    def __enter__(self):
        self._browser.__enter__()
        return self

    def __exit__(self, *error):
        self._browser.__exit__(*error)

    def open(self, size, view: str) -> None:
        """Opens the page in a window of some size (px), seen by one of its cameras."""
        self._browser.resize(*size)
        self._browser.open(self._page.as_uri())
        self._browser.wait_for(_READY)
        self._browser.evaluate(f"airrace.cameras.choose('{view}')")

    def hide(self, element: str) -> None:
        """Hides an element of the page, by its ID."""
        self._browser.evaluate(f"document.getElementById('{element}').style.display = 'none'")

    def look(self, time: float) -> Image.Image:
        """Returns what is seen at a time (s)."""
        self._browser.evaluate(f"airrace.player.jump({time})")
        # Its numbers and small pictures follow within some frames.
        self._browser.evaluate("new Promise(done => setTimeout(done, 150))")
        picture = self._browser.screenshot()
        assert not self._browser.errors, self._browser.errors
        return Image.fromarray(np.ascontiguousarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)))


def still(replay: Replay, lap: dict, path: Path) -> None:
    """Writes the track, a third through a lap, where no panel is above the drone."""
    replay.open(_STILL, "overview")
    replay.look(lap["start_s"])  # the first frame loads what it shows
    picture = replay.look(lap["start_s"] + 0.36 * lap["time_s"])
    picture.save(path, quality=65, method=6)


def animation(replay: Replay, lap: dict, path: Path) -> None:
    """Writes a lap from behind the drone as an animated WebP."""
    replay.open(_FILM, "chase")
    replay.hide("bar")
    replay.look(lap["start_s"])
    times = lap["start_s"] + np.arange(0.0, lap["time_s"], _SPEED / _FPS)
    size = _FILM_WIDTH, round(_FILM_WIDTH * _FILM[1] / _FILM[0])
    frames = [
        replay.look(time).resize(size, Image.Resampling.LANCZOS)
        for time in progress(times, "Drawing")
    ]
    frames[0].save(
        path,
        save_all=True,
        append_images=frames[1:],
        duration=round(1000 / _FPS),
        loop=0,
        quality=30,
        method=6,
    )


def run(args) -> int:
    """Makes the pictures; returns the exit code."""
    from airrace.analysis import load_run

    if CHROMIUM is None:
        raise UserError("There is no Chromium to photograph the replay with: install chromium.")
    args.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        flown = load_run(args.run) if args.run else fly(folder)
        with Replay(flown, folder) as replay:
            still(replay, flown.result["laps"][0], args.output / "track.webp")
            animation(replay, flown.result["laps"][0], args.output / "race.webp")
    for path in sorted(args.output.glob("*.webp")):
        print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB")
    return 0


def main(argv=None) -> int:
    """The command-line program; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="tools.make_pictures",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--run", type=Path, help="show this run's first lap instead of flying one")
    parser.add_argument("--output", type=Path, default=FOLDER, help="default: docs/pictures")
    args = parser.parse_args(argv)
    return exit_code(lambda: run(args))


if __name__ == "__main__":
    sys.exit(main())
