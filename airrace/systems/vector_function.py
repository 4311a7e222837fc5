"""A function of vectors as a system of Drake, for numbers, derivatives and symbols alike."""

from collections.abc import Callable

import numpy as np
from pydrake.systems.framework import LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem


@TemplateSystem.define("VectorFunction_")
def VectorFunction_(T: type) -> type:
    """Makes the classes for the scalar types of Drake."""

    class Impl(LeafSystem_[T]):
        """Applies a function to its input.

        .. pydrake_system::

            name: VectorFunction
            input_ports:
            - input
            output_ports:
            - output
        """

        def _construct(self, function, inputs, outputs, converter=None):
            LeafSystem_[T].__init__(self, converter)
            self._arguments = function, inputs, outputs
            port = self.DeclareVectorInputPort("input", inputs)

            def calc(context, output):
                with np.errstate(invalid="ignore"):  # of which numpy warns where it meets symbols
                    output.SetFromVector(np.asarray(function(port.Eval(context))))

            self.DeclareVectorOutputPort("output", outputs, calc)

        def _construct_copy(self, other, converter=None):
            Impl._construct(self, *other._arguments, converter=converter)

    return Impl


def VectorFunction(
    function: Callable[[np.ndarray], np.ndarray], inputs: int, outputs: int, name: str
) -> LeafSystem_[float]:
    """Makes a system of a function.

    Args:
        function: a vector (inputs,) to a vector (outputs,), by arithmetic and numpy's functions,
            so that it takes floats, AutoDiffXd and Expression.
        inputs, outputs: how many numbers go in and come out.
        name: of the system.
    """
    system = VectorFunction_[float](function, inputs, outputs)
    system.set_name(name)
    return system
