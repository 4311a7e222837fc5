"""The sensor beside a SceneGraph in which a ball stands for the drone; pushes are made up."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.geometry import (
    Box,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    ProximityProperties,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from airrace.systems.sensing.contact_sensor import (
    CONTACTS_SIZE,
    ENVIRONMENT,
    GATE,
    ContactSensor,
    as_contacts,
)

RATE, WEIGHT, STANDING = 120.0, 9.0, 0.1
# Where the things are (m).
PLACES = {"gate_3": [0.0, 0.0, 2.0], "wall": [9.0, 0.0, 2.0], "ground": [0.0, 0.0, -0.5]}
SIZES = {"gate_3": (0.2, 0.2, 0.2), "wall": (0.2, 9.0, 9.0), "ground": (99.0, 99.0, 1.0)}


class Touching:
    """A sensor whose drone is moved and pushed by hand."""

    def __init__(self):
        builder = DiagramBuilder()
        graph = builder.AddSystem(SceneGraph())
        source = graph.RegisterSource("world")
        self.frame = graph.RegisterFrame(source, GeometryFrame("drone"))
        ball = GeometryInstance(RigidTransform(), Sphere(0.1), "drone")
        ball.set_proximity_properties(ProximityProperties())
        graph.RegisterGeometry(source, self.frame, ball)
        names = {}
        for name, place in PLACES.items():
            thing = GeometryInstance(RigidTransform(place), Box(*SIZES[name]), name)
            thing.set_proximity_properties(ProximityProperties())
            names[graph.RegisterAnchoredGeometry(source, thing)] = name
        self.sensor = builder.AddSystem(
            ContactSensor(rate=RATE, standing_height=STANDING, weight=WEIGHT, body_names=names)
        )
        builder.Connect(graph.get_query_output_port(), self.sensor.GetInputPort("geometry_query"))
        for name in ("state", "contact_results", "contact_impulse"):
            builder.ExportInput(self.sensor.GetInputPort(name), name)
        builder.ExportInput(graph.get_source_pose_port(source), "poses")
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()
        self.diagram.GetInputPort("contact_results").FixValue(self.context, Value(ContactResults()))
        self.total = np.zeros(3)
        self.move(0.0, 0.0, STANDING)
        self.push()

    def move(self, *place):
        """The drone is at a place (m)."""
        poses = FramePoseVector()
        poses.set_value(self.frame, RigidTransform(list(place)))
        self.diagram.GetInputPort("poses").FixValue(self.context, Value(poses))
        state = np.concatenate([[1.0, 0.0, 0.0, 0.0], place, np.zeros(6)])
        self.diagram.GetInputPort("state").FixValue(self.context, state)

    def push(self, *impulse):
        """Something pushes (kg m/s), or nothing; a sample follows."""
        self.total[: len(impulse)] += impulse
        wrench = np.concatenate([np.zeros(3), self.total])
        self.diagram.GetInputPort("contact_impulse").FixValue(self.context, wrench)
        self.simulator.AdvanceTo(self.context.get_time() + 1.0 / RATE)
        return self.contacts

    @property
    def contacts(self):
        context = self.sensor.GetMyContextFromRoot(self.context)
        return as_contacts(self.sensor.get_output_port().Eval(context).copy())


@pytest.fixture
def flying():
    touching = Touching()
    touching.move(0.0, 0.0, 5.0)
    touching.push()
    return touching


def test_what_stands_touches_nothing():
    touching = Touching()
    for _ in range(5):
        contacts = touching.push(0.0, 0.0, WEIGHT / RATE)
    assert (contacts.gates, contacts.environment, contacts.airborne) == (0.0, 0.0, 0.0)
    touching.move(0.0, 0.0, 1.0)
    assert touching.push().airborne == 1.0


@pytest.mark.parametrize("place, kind", [((0.3, 0.0, 2.0), GATE), ((8.7, 0.0, 2.0), ENVIRONMENT)])
def test_what_is_nearest_was_touched(flying, place, kind):
    flying.move(*place)
    contacts = flying.push(0.3, -0.4)
    assert (contacts.gates, contacts.environment) == ((1.0, 0.0) if kind == GATE else (0.0, 1.0))
    assert contacts.kind == kind and contacts.impulse == pytest.approx(0.5)


def test_each_sample_with_a_push_is_one(flying):
    flying.move(0.3, 0.0, 2.0)
    for _ in range(3):
        flying.push(0.1)
    before = flying.contacts
    assert before.gates == 3.0 and before.impulse == pytest.approx(0.1)
    # Without one, the last one is remembered.
    after = flying.push()
    assert after.gates == 3.0 and after.impulse == before.impulse and after.time > before.time
    np.testing.assert_allclose(after.total, [0.3, 0.0, 0.0])


def test_the_floor_counts_only_if_it_is_hit(flying):
    flying.move(5.0, 0.0, STANDING)
    assert flying.push(0.0, 0.0, 2.9 * WEIGHT / RATE).environment == 0.0
    contacts = flying.push(0.0, 0.0, 3.1 * WEIGHT / RATE)
    assert contacts.environment == 1.0 and contacts.gates == 0.0
    # A gate counts however little it pushes.
    flying.move(0.3, 0.0, 2.0)
    assert flying.push(1e-6).gates == 1.0


def test_the_vector_has_all_parts():
    contacts = as_contacts(np.arange(float(CONTACTS_SIZE)))
    assert [*contacts[:6], *contacts.total] == list(range(CONTACTS_SIZE))
