"""Tests mirror airrace/: airrace/track/rules.py is tested by tests/track/test_rules.py.

The modules below are tested by a file of another name; what that does beyond their own is tested
there, too. `.venv/bin/python -m tests.test_mirror` prints the table as it should be.

analysis/command.py                      analysis/test_run.py
analysis/derived.py                      analysis/test_run.py
analysis/figure_style.py                 analysis/test_report.py
analysis/figures_estimator.py            analysis/test_report.py
analysis/figures_explorer.py             analysis/test_report.py
analysis/figures_laps.py                 analysis/test_report.py
analysis/figures_signals.py              analysis/test_report.py
analysis/figures_track.py                analysis/test_report.py
analysis/page_templates.py               analysis/test_report.py
analysis/signals.py                      analysis/test_run.py
betaflight/guard_process.py              betaflight/test_guard.py
commands/computer_checks.py              commands/test_doctor.py
common/command_line.py                   commands/test_app.py
common/errors.py                         commands/test_app.py
common/immutable.py                      rendering/imaging/test_lens.py
common/version.py                        test_project_files.py
diagrams/command_watchdog.py             systems/failsafe/test_command_watchdog.py
diagrams/drone_alone.py                  drake_user/test_drone_alone.py
diagrams/estimators.py                   diagrams/test_vio_race.py
diagrams/in_process.py                   diagrams/test_race.py
diagrams/own_systems.py                  diagrams/test_autonomy.py
diagrams/race_command.py                 commands/test_race.py
diagrams/standing_drone.py               diagrams/test_warm_up.py
diagrams/transport.py                    hitl/link/test_lockstep.py
diagrams/variants.py                     diagrams/test_autonomy.py
diagrams/world.py                        diagrams/test_simulation.py
envs/batch/courses.py                    envs/batch/test_contact.py
envs/batch/fleet.py                      envs/batch/test_lanes.py
envs/batch/step.py                       envs/batch/test_vector_env.py
envs/env_diagram.py                      envs/test_race_env.py
envs/options.py                          envs/test_race_env.py
envs/spectator.py                        envs/test_race_env.py
envs/start.py                            envs/test_race_env.py
evaluation/jobs.py                       evaluation/test_worker.py
evaluation/progress.py                   evaluation/test_command.py
evaluation/race_process.py               evaluation/test_worker.py
evaluation/races_display.py              evaluation/test_command.py
hitl/channels.py                         hitl/test_imu_channel.py
hitl/companion/ssh.py                    hitl/companion/test_ssh_errors.py
hitl/lcm_bridge.py                       hitl/test_imu_channel.py
hitl/link/bus.py                         hitl/link/test_udp_bus.py
hitl/link/codec.py                       hitl/link/test_image_messages.py
hitl/link/message_socket.py              hitl/link/test_socket_bus.py
hitl/link/packets.py                     hitl/link/test_endpoint.py
hitl/link/phases.py                      hitl/test_autonomy_process.py
hitl/link/plan_messages.py               hitl/test_imu_channel.py
hitl/link/probe.py                       hitl/link/test_doctor.py
hitl/link/simulated_bus.py               hitl/link/test_lockstep.py
hitl/lockstep_autonomy.py                hitl/test_hitl_race.py
hitl/navigator.py                        hitl/test_pilot.py
hitl/navigator_process.py                hitl/test_hitl_race.py
hitl/playback.py                         diagrams/test_warm_up.py
league/check.py                          league/test_entry_race.py
league/display.py                        league/test_command.py
league/league_json.py                      league/test_folder_check.py
league/sandbox.py                        league/test_entry_race.py
league/season_files.py                   league/test_proof.py
league/season_run.py                     league/test_command.py
league/worker.py                         league/test_entry_race.py
mavlink/flight_controller.py             hitl/test_simulated_link.py
mavlink/grand_prix.py                    mavlink/test_client_transport.py
mavlink/splitter.py                      mavlink/test_client_link.py
recording/log_sink.py                    recording/test_recorded_race.py
recording/race_changes.py                recording/test_race_observer.py
recording/race_events.py                 recording/test_race_observer.py
rendering/images.py                      rendering/planar/test_polygons.py
rendering/planar/background.py           rendering/vtk/test_atmosphere.py
rendering/planar/projection.py           rendering/planar/test_polygons.py
rendering/planar/pylons.py               rendering/planar/test_planar_scene.py
rendering/planar/renderer.py             rendering/planar/test_planar_scene.py
rendering/scene/meshes.py                rendering/scene/test_scenery.py
rendering/scene/pylon_shape.py           rendering/scene/test_shadows.py
scenario/checks.py                       scenario/test_scenario.py
scenario/mavlink_config.py               scenario/test_scenario.py
scenario/options.py                      commands/test_race.py
scenario/visualization_config.py         drake_user/test_open_world.py
systems/control/attitude_controller.py   systems/control/test_flight_cascade.py
systems/control/rotor_commands.py        systems/control/test_geometric_controller.py
systems/control/velocity_controller.py   systems/control/test_flight_cascade.py
systems/estimation/slam_filter.py        systems/estimation/test_gate_slam.py
systems/estimation/slam_state.py         systems/estimation/test_gate_slam.py
systems/exploring/explorer_memory.py     systems/exploring/test_search.py
systems/perception/edge_profile.py       systems/perception/test_corner_refit.py
systems/perception/edges.py              systems/perception/test_corner_refit.py
systems/perception/marker_measurement.py systems/perception/test_aruco_detector.py
systems/perception/marker_modules.py     systems/perception/test_detection_checks.py
systems/perception/marker_search.py      systems/perception/test_aruco_detector.py
systems/perception/pose_refinement.py    systems/perception/test_marker_pose.py
systems/planning/lap_plan.py             systems/planning/test_lap_planner.py
systems/planning/laps.py                 systems/planning/test_lap_planning.py
systems/planning/min_snap_laps.py        systems/planning/test_lap_planning.py
systems/planning/plan_checks.py           systems/planning/test_lap_planner.py
systems/planning/time_optimal_laps.py    systems/planning/test_lap_planning.py
systems/plant/drawn_body.py              drake_user/test_random.py
systems/policy/command_switch.py         systems/policy/test_policy_controller.py
systems/seed.py                          drake_user/test_random.py
systems/sensing/contact_names.py         systems/sensing/test_contact_sensor.py
systems/sensing/imu_samples.py           systems/sensing/test_imu.py
systems/sensing/picture_ports.py         hitl/link/test_image_messages.py
systems/sensing/pose_history.py          systems/sensing/test_state_estimate.py
systems/types.py                         systems/test_referee.py
systems/vector_function.py               drake_user/test_drone_alone.py
track/gate_map.py                        track/test_map_files.py
track/hall.py                            track/test_generator.py
trajopt/errors.py                        trajopt/test_gate_regions.py
trajopt/flight_limits.py                 trajopt/test_round_trip.py
trajopt/hermite.py                       trajopt/min_snap/test_min_snap.py
trajopt/reference.py                     trajopt/test_round_trip.py
trajopt/time_optimal/dynamics.py         trajopt/time_optimal/test_lap_step.py
trajopt/time_optimal/dynamics_limits.py  trajopt/time_optimal/test_optimal_lap.py
trajopt/time_optimal/lap_samples.py      trajopt/time_optimal/test_lap_step.py
trajopt/time_optimal/lap_search.py       trajopt/time_optimal/test_optimal_lap.py
trajopt/time_optimal/optimal_circuit.py  trajopt/time_optimal/test_optimal_lap.py
trajopt/time_optimal/path_terms.py       trajopt/time_optimal/test_optimal_lap.py
trajopt/time_optimal/visibility.py       trajopt/time_optimal/test_lap_step.py
vehicle/camera_info.py                   systems/sensing/test_camera.py
vehicle/imu_errors.py                    systems/sensing/test_imu.py
vehicle/rotors.py                        systems/plant/test_rotor_bank.py
vehicle/state.py                         mavlink/test_frames.py
visualization/ghosts.py                  visualization/test_command.py
"""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def elsewhere() -> dict[str, str]:
    """Returns the table above: modules to their tests."""
    return dict(re.findall(r"^(\S+\.py) +(\S+\.py)$", __doc__, re.M))


def without_a_mirror() -> list[str]:
    """Returns the modules that no test has the name of."""
    modules = (path.relative_to(ROOT / "airrace") for path in (ROOT / "airrace").rglob("*.py"))
    return sorted(
        str(module)
        for module in modules
        if not module.stem.startswith("__")
        and module.parts[0] != "lcmtypes"  # written by lcm-gen
        and not (ROOT / "tests" / module.with_name(f"test_{module.name}")).exists()
    )


def test_every_module_is_tested():
    assert list(elsewhere()) == without_a_mirror()
    assert not [test for test in elsewhere().values() if not (ROOT / "tests" / test).is_file()]


if __name__ == "__main__":
    for module in without_a_mirror():
        print(f"{module:40s}  {elsewhere().get(module, '?')}")
