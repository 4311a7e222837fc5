import functools
import gc
import weakref

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems import framework
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, ValueProducer

from airrace.systems.leaf_system import LeafSystem


class Counter(LeafSystem):
    """Has a callback of every kind: methods, a lambda and a partial."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.published = 0
        self._count = self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, self._update)
        self.DeclarePeriodicPublishEvent(period_sec=0.1, offset_sec=0.0, publish=self._publish)
        entry = self.DeclareCacheEntry(
            "twice",
            ValueProducer(allocate=lambda: Value[object](()), calc=self.held(self._twice)),
            {self.xd_ticket()},
        )
        self._entry = entry.cache_index()
        self.DeclareVectorOutputPort(
            "twice", 1, lambda context, output: output.SetFromVector(self._recall(context))
        )
        self.DeclareVectorOutputPort("shifted", 1, functools.partial(self._shifted, 10.0))
        self.DeclareAbstractOutputPort("list", lambda: Value[object]([]), self._list)

    def _update(self, context, discrete_state):
        discrete_state.get_mutable_value(self._count)[:] += 1.0

    def _publish(self, context):
        self.published += 1

    def _twice(self, context, value):
        value.set_value(tuple(2.0 * self._now(context)))

    def _recall(self, context):
        return self.get_cache_entry(self._entry).Eval(context)

    def _now(self, context):
        return context.get_discrete_state(self._count).value()

    def _shifted(self, by, context, output):
        output.SetFromVector(self._now(context) + by)

    def _list(self, context, output):
        output.set_value(list(self._now(context)))


def in_diagram(system):
    builder = DiagramBuilder()
    builder.AddSystem(system)
    return builder.Build()


def test_it_does_what_drakes_does():
    counter = Counter()
    simulator = Simulator(in_diagram(counter))
    simulator.AdvanceTo(0.95)
    context = counter.GetMyContextFromRoot(simulator.get_context())
    for name, value in (("twice", 20.0), ("shifted", 20.0)):
        np.testing.assert_array_equal(counter.GetOutputPort(name).Eval(context), [value])
    assert counter.GetOutputPort("list").Eval(context) == [10.0]
    assert counter.published == 10 and isinstance(counter, framework.LeafSystem)


def test_it_goes_away_with_its_diagram():
    counter = Counter()
    reference = weakref.ref(counter)
    simulator = Simulator(in_diagram(counter))
    simulator.AdvanceTo(0.35)
    del counter
    gc.collect()
    assert reference().published == 4  # the diagram has it
    simulator.AdvanceTo(0.55)
    assert reference().published == 6
    del simulator
    gc.collect()
    assert reference() is None


def test_an_error_in_a_callback_is_told():
    class Broken(LeafSystem):
        def __init__(self):
            LeafSystem.__init__(self)
            self.DeclareVectorOutputPort("none", 1, self._calc)

        def _calc(self, context, output):
            raise ArithmeticError("as it should")

    broken = Broken()
    with pytest.raises(ArithmeticError, match="as it should"):
        broken.get_output_port().Eval(broken.CreateDefaultContext())
