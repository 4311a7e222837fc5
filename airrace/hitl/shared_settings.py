"""What both sides of a link must have in common, or they do not fly the same drone."""

import dataclasses as dc
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from airrace.vehicle import load_vehicle

if TYPE_CHECKING:
    from airrace.hitl.channels import PortChannel
    from airrace.scenario import Scenario


def shared_settings(
    scenario: "Scenario", channels: "Iterable[PortChannel]"
) -> dict[str, bool | int | float | str | None]:
    """Returns the plain value of each field that must be equal, by its name in a scenario.

    They are the estimator, the camera, the rates of all systems, the drone with all that its
    vehicle.yaml says, wherever that is, and what crosses the link.

    Args: channels: of the race.

    Raises UserError if there is no such drone.
    """
    vehicle, _ = load_vehicle(scenario.drone)
    rates = {
        f"{name}.rate": config.rate
        for name, config in vars(scenario).items()
        if dc.is_dataclass(config) and hasattr(config, "rate")
    }
    camera = dc.asdict(scenario.camera)
    del camera["renderer"]  # the simulation's alone, as is the model
    return {
        "estimator": scenario.estimator,
        **dict(_fields("camera", camera)),
        **rates,
        "plant_config.time_step": scenario.plant_config.time_step,
        "perception.latency": scenario.perception.latency,
        **dict(_fields("drone", dc.asdict(dc.replace(vehicle, model="")))),
        "channels": " ".join(sorted(channel.name for channel in channels)),
    }


def _fields(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yields each plain value in a tree of dicts and lists, with its name: ``camera.fps``."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield from _fields(f"{name}.{key}", each)
    elif isinstance(value, (list, tuple)):
        for i, each in enumerate(value):
            yield from _fields(f"{name}[{i}]", each)
    else:
        yield name, value
