"""Flies a lap of the hexagon with the entry: python -m pytest NAME, or python NAME/test_lap.py."""

from pathlib import Path

from airrace.commands.app import main


def test_a_lap():
    # Where there is no sandbox, add "--unsafe": it is your own code.
    assert main(["league", "check", str(Path(__file__).parent)]) == 0


if __name__ == "__main__":
    test_a_lap()
