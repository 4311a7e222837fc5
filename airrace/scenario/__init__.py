"""The race as data: everything that defines it, as one YAML file.

scenario.py has its fields; checks.py says what their values may be.
"""

from airrace.scenario.scenario import (
    BETAFLIGHT,
    CONTENTS,
    CORNERS,
    INTERNAL,
    LEARNED,
    LINK_DELAY,
    MAP_ESTIMATORS,
    MSP,
    NO_POLICY,
    POSES,
    TRAJECTORIES,
    TRUTH,
    VIO,
    ControllerConfig,
    ExplorerConfig,
    PerceptionConfig,
    PlannerConfig,
    RecordingConfig,
    RotorsConfig,
    Scenario,
    StateEstimateConfig,
    StateFilterConfig,
    laps_name,
    load_scenario,
    scenario_yaml,
    trajectory_name,
)
