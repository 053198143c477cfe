"""Networks of TensorFlow Lite on the CPU, by the package ai-edge-litert."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from jaxtyping import Float32

from carigs.system.extras import need

RUNTIME = "ai_edge_litert"
"""The package that runs networks."""
STDERR = 2
"""File descriptor."""
REMARK = b"INFO: "
"""How a line of the runtime begins that tells of nothing wrong."""


@contextmanager
def without_remarks() -> Iterator[None]:
    """Leave out what the runtime remarks on standard error, past Python: that it made itself a delegate.

    Other lines, such as those of errors, are written after the block.

    Yields:
        Nothing.
    """
    sys.stderr.flush()
    try:
        stderr = os.dup(STDERR)
    except OSError:  # it is closed
        yield
        return
    with tempfile.TemporaryFile() as kept, os.fdopen(stderr, "wb") as original:
        os.dup2(kept.fileno(), STDERR)
        try:
            yield
        finally:
            sys.stderr.flush()
            os.dup2(stderr, STDERR)
            kept.seek(0)
            original.writelines(line for line in kept if not line.startswith(REMARK))


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

        with without_remarks():
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
