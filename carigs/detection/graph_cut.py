"""Parts of a TensorFlow Lite graph as graphs of their own, for operations that a runtime lacks."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import Any

CUSTOM = 32
"""`BuiltinOperator.CUSTOM` of the schema of TensorFlow Lite."""


def read_graph(content: bytes) -> Any:
    """Unpack a file of TensorFlow Lite.

    Args:
        content: The file.

    Returns:
        `ModelT` of the schema.
    """
    from ai_edge_litert import schema_py_generated as schema

    return schema.ModelT.InitFromObj(schema.Model.GetRootAsModel(content, 0))


def custom_operations(graph: Any, name: str) -> list[Any]:
    """Find the operations of a kind that is not built in.

    Args:
        graph: Result of `read_graph`.
        name: Name of the custom operation.

    Returns:
        `OperatorT` of each, in the order of the graph.
    """
    kinds = [code.customCode == name.encode() for code in graph.operatorCodes]
    return [operation for operation in graph.subgraphs[0].operators if kinds[operation.opcodeIndex]]


def cut(graph: Any, inputs: Sequence[int], outputs: Sequence[int]) -> bytes:
    """Cut out the operations that compute some tensors from others.

    Args:
        graph: Result of `read_graph`; it stays as it is.
        inputs: Numbers of the tensors that are given.
        outputs: Numbers of the tensors that are wanted.

    Returns:
        File of TensorFlow Lite with these inputs and outputs.
    """
    import flatbuffers

    needed, kept = set(outputs), []
    for operation in reversed(graph.subgraphs[0].operators):
        if needed.intersection(operation.outputs) - set(inputs):
            needed.update(operation.inputs)
            kept.append(operation)
    part, model = copy(graph.subgraphs[0]), copy(graph)
    part.operators, part.inputs, part.outputs = kept[::-1], list(inputs), list(outputs)
    model.subgraphs, model.signatureDefs = [part], None
    builder = flatbuffers.Builder()
    builder.Finish(model.Pack(builder), b"TFL3")
    return bytes(builder.Output())
