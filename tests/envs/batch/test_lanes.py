"""The batch's drones against Drake's plant."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from airrace.common.jit import compiled
from airrace.envs.batch.fleet import make_bodies, make_fleet
from airrace.envs.batch.lanes import (
    LANES,
    follow_commands,
    load,
    make_block,
    step_plant,
    store,
    sum_thrusts,
)
from airrace.systems.plant.drag import Drag
from airrace.systems.plant.multirotor import AddMultirotor, AddMultirotorModel, ApplyForces
from airrace.vehicle import RACERS, load_vehicle
from airrace.vehicle.state import as_plant_state

DT, ROTOR_PERIOD, WIND = 0.001, 0.002, (3.0, -2.0, 0.5)
SHARE = 0.7  # of the drag
HOLD = 0.1  # s, for each command


class Plant:
    """A drone in Drake's plant, in drag and wind."""

    def __init__(self, name):
        self.vehicle, sdf = load_vehicle(name)
        builder = DiagramBuilder()
        self.plant, scene_graph = AddMultibodyPlantSceneGraph(builder, DT)
        body = AddMultirotorModel(self.plant, self.vehicle, sdf)
        self.plant.Finalize()
        drag = builder.AddSystem(Drag(vehicle=self.vehicle, share=SHARE, body_index=body.index()))
        air = builder.AddSystem(ConstantVectorSource(WIND))
        builder.Connect(self.plant.get_state_output_port(), drag.GetInputPort("state"))
        builder.Connect(air.get_output_port(), drag.GetInputPort("wind"))
        self.rotors, thrusts = AddMultirotor(
            builder, body, scene_graph, self.vehicle, rate=1.0 / ROTOR_PERIOD
        )
        ApplyForces(builder, self.plant, [thrusts, drag.GetOutputPort("spatial_forces")])
        builder.ExportInput(self.rotors.GetInputPort("rotor_speed_command"), "command")
        self.diagram = builder.Build()

    def fly(self, state, speeds, commands):
        """Returns the state after commands (k, n), each for HOLD."""
        simulator = Simulator(self.diagram)
        context = simulator.get_mutable_context()
        self.plant.SetPositionsAndVelocities(self.plant.GetMyMutableContextFromRoot(context), state)
        self.rotors.set_speeds(self.rotors.GetMyMutableContextFromRoot(context), speeds)
        for k, command in enumerate(commands):
            self.diagram.get_input_port().FixValue(context, command)
            simulator.AdvanceTo((k + 1) * HOLD - DT / 2)  # before the next one is taken up
        return self.plant.GetPositionsAndVelocities(self.plant.GetMyContextFromRoot(context))


PLANTS = {name: Plant(name) for name in RACERS}


@compiled
def fly(fleet, commands, bodies):
    """Flies the only drone of a fleet, as Plant.fly() does."""
    block = make_block(len(bodies.max_speeds), 1)
    load(block, 0, 1, fleet, bodies)
    sum_thrusts(block, bodies.levers)
    for command in commands:
        block.new.reshape(-1, LANES)[:, 0] = command
        for step in range(round(HOLD / DT)):
            step_plant(block, bodies.drag, DT)
            if step % round(ROTOR_PERIOD / DT) == 0:
                follow_commands(block, bodies)
                sum_thrusts(block, bodies.levers)
    store(block, 0, 0, fleet)


@pytest.mark.slow
@pytest.mark.parametrize("name", RACERS)
@settings(max_examples=25, deadline=None)
@given(st.data())
def test_a_second_of_flight_is_that_of_the_plant(name, data):
    """From any state, by any commands, also such as no rotor can follow."""
    plant = PLANTS[name]
    n = len(plant.vehicle.rotors)
    generator = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    q = generator.standard_normal(4)
    state = np.concatenate(
        [
            q / np.linalg.norm(q),
            generator.uniform(-50.0, 50.0, 3),
            generator.uniform(-15.0, 15.0, 3),
            generator.uniform(-30.0, 30.0, 3),
        ]
    )
    state[6] += 100.0  # there is no ground
    speeds = generator.uniform(0.0, 92.0, n)
    commands = generator.uniform(-20.0, 120.0, (round(1.0 / HOLD), n))
    bodies = make_bodies(plant.vehicle, 1, ROTOR_PERIOD, SHARE)
    fleet = make_fleet(1, n, 4, 1)
    fleet.state[0], fleet.speeds[0], fleet.wind[0] = state, speeds, WIND
    fleet.thrusts[0] = plant.vehicle.thrust_coefficients * speeds**2
    fly(fleet, commands, bodies)
    batch = as_plant_state(fleet.state[0])
    drake = as_plant_state(plant.fly(state, speeds, commands))
    for part in ("position", "velocity", "angular_velocity", "quaternion"):
        np.testing.assert_allclose(getattr(batch, part), getattr(drake, part), atol=1e-9, rtol=0.0)
