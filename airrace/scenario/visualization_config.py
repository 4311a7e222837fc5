"""The part of a scenario that says how Drake's own means show it."""

import dataclasses as dc


@dc.dataclass
class VisualizationConfig:
    """Drake's config of this name, whose documentation says more, without its colours.

    It is not Drake's class itself: that is in a module whose import brings matplotlib along, and
    would take every command 0.15 s.
    """

    lcm_bus: str = "default"  # for Meldis; or "", for none
    publish_period: float = 1.0 / 64.0  # s
    publish_illustration: bool = True  # what is seen
    publish_proximity: bool = True  # what collides
    initial_proximity_alpha: float = 0.5  # how opaque that is at first
    publish_contacts: bool = True  # forces of contact
    publish_inertia: bool = True  # ellipsoids of the bodies' inertia
    enable_meshcat_creation: bool = True  # a Meshcat of its own
    delete_on_initialization_event: bool = True  # clears it when a race begins
    enable_alpha_sliders: bool = False  # in Meshcat, for each of these
