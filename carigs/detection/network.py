"""Networks of TensorFlow Lite on the CPU, by the package ai-edge-litert."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from carigs.system.extras import need

RUNTIME = "ai_edge_litert"
"""The package that runs networks."""


class Network:
    """A network with its weights. It uses one thread: equal inputs give equal bytes.

    Args:
        content: File of TensorFlow Lite.

    Raises:
        PackageMissing: If ai-edge-litert is not installed.
        ValueError: If the runtime lacks an operation of the network, or this is none.
    """

    def __init__(self, content: bytes) -> None:
        need(RUNTIME)
        from ai_edge_litert.interpreter import Interpreter

        self._interpreter = Interpreter(model_content=content, num_threads=1)
        self._interpreter.allocate_tensors()
        self._inputs = [tensor["index"] for tensor in self._interpreter.get_input_details()]
        self._outputs = [tensor["index"] for tensor in self._interpreter.get_output_details()]

    def __call__(self, *inputs: Float32[np.ndarray, "..."]) -> list[Float32[np.ndarray, "..."]]:
        """Run the network.

        Args:
            inputs: Its inputs, in its order.

        Returns:
            Copies of its outputs, in its order.
        """
        for index, value in zip(self._inputs, inputs, strict=True):
            self._interpreter.set_tensor(index, value)
        self._interpreter.invoke()
        return [self._interpreter.get_tensor(index) for index in self._outputs]
