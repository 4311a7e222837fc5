"""What the drone touches, and how hard, for flights that go on after a contact."""

from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import QueryObject
from pydrake.multibody.plant import ContactResults

from airrace.common.packing import Packing
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.systems.sensing.contact_names import FLOOR, TAKE_OFF, nearest_name
from airrace.vehicle.state import STATE_SIZE, as_plant_state

CONTACT_RATE = 250.0  # Hz
GATE, ENVIRONMENT = 0, 1
_STANDING = 3.0  # times the weight: the floor's push below this is no impact


class Contacts(NamedTuple):
    """Contacts so far."""

    #: gates, environment: how many samples had a contact with each
    gates: float
    environment: float
    kind: float  #: GATE or ENVIRONMENT, of the last one
    impulse: float  #: of it (kg m/s)
    airborne: float  #: 1 once the drone has taken off; contacts before do not count
    time: float  #: of the last sample (s)
    total: np.ndarray  #: impulse of all contacts until then (kg m/s), (3,)


_PACKING = Packing(Contacts, total=3)
as_contacts, contacts_vector, CONTACTS_SIZE = _PACKING.parts, _PACKING.vector, _PACKING.size


class ContactSensor(LeafSystem):
    """Counts samples with a contact.

    .. pydrake_system::

        name: ContactSensor
        input_ports:
        - state
        - contact_results
        - contact_impulse
        - geometry_query
        output_ports:
        - contacts

    Its inputs are as Referee's; ``contacts`` is the vector of Contacts (9). A sample has a contact
    if the impulse on the drone has changed since the one before, even if it lasted one step of the
    plant; what is nearest then is what was touched. The floor counts only if it is hit.
    """

    def __init__(self, *, rate: float, standing_height: float, weight: float, body_names: dict):
        """Constructs the sensor.

        Args:
            rate: of its samples (Hz).
            standing_height: of the body's origin when the drone stands on its pad (m).
            weight: of the drone (N).
            body_names: geometry IDs to names, as for Referee.
        """
        LeafSystem.__init__(self)
        self._period, self._names = 1.0 / rate, body_names
        self._take_off_height = standing_height + TAKE_OFF
        self._little = _STANDING * weight / rate
        self._state = self.DeclareVectorInputPort("state", STATE_SIZE - 1)
        self._results = self.DeclareAbstractInputPort("contact_results", Value(ContactResults()))
        self._impulse = self.DeclareVectorInputPort("contact_impulse", 6)
        self._query = self.DeclareAbstractInputPort("geometry_query", Value(QueryObject()))
        memory = self.DeclareDiscreteState(CONTACTS_SIZE)
        self.DeclarePeriodicDiscreteUpdateEvent(self._period, 0.0, self._sample)
        self.DeclareStateOutputPort("contacts", memory)

    def _sample(self, context, discrete_state):
        memory = discrete_state.get_mutable_value()
        before = as_contacts(memory)
        total = read_vector(self._impulse, context)[3:6]
        impulse = float(np.linalg.norm(total - before.total))
        height = as_plant_state(read_vector(self._state, context)).position[2]
        airborne = float(before.airborne or height > self._take_off_height)
        after = before._replace(airborne=airborne, time=context.get_time(), total=total)
        name = None
        if airborne and impulse != 0.0:
            contacts, query = self._results.Eval(context), self._query.Eval(context)
            name = nearest_name(contacts, query, self._names, airborne=True)
        if name is None or (name in FLOOR and impulse < self._little):
            pass
        elif name.startswith("gate_"):
            after = after._replace(gates=after.gates + 1.0, kind=GATE, impulse=impulse)
        else:
            after = after._replace(
                environment=after.environment + 1.0, kind=ENVIRONMENT, impulse=impulse
            )
        memory[:] = contacts_vector(after)
