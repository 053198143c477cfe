"""The operations of the network that the runtime lacks, and the parts that its graph is cut into."""

import importlib.util

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from carigs.detection.attention_mesh import CELLS, MARGIN, REGIONS, features_from_region, sampled

needs_runtime = pytest.mark.skipif(importlib.util.find_spec("ai_edge_litert") is None, reason="needs ai-edge-litert")


@given(st.floats(-0.9, 0.9), st.floats(0.3, 2), st.floats(-10, 10), st.floats(-10, 10))
def test_features_are_sampled_bilinearly_with_cell_centres_at_a_half(angle, scale, x, y):
    features = np.random.default_rng(0).normal(size=(20, 30, 3)).astype(np.float32)
    matrix = np.array([[np.cos(angle), -np.sin(angle), 5 + x], [np.sin(angle), np.cos(angle), 5 + y]])
    matrix[:, :2] *= scale
    rows, columns = np.mgrid[:CELLS, :CELLS] + 0.5
    at = matrix[:, :2] @ np.stack([columns.ravel(), rows.ravel()]) + matrix[:, 2:] - 0.5
    expected = [map_coordinates(features[..., c], at[::-1], order=1, mode="constant") for c in range(3)]
    inside = ((at >= 0) & (at <= [[29], [19]])).all(axis=0)
    found = sampled(features, matrix).reshape(-1, 3)
    np.testing.assert_allclose(found[inside], np.stack(expected, axis=-1)[inside], atol=1e-4)
    assert (found[~inside] == 0).all()


@pytest.mark.parametrize("region", REGIONS)
@given(angle=st.floats(-3, 3))
def test_a_region_holds_its_landmarks_upright_and_with_a_margin(region, angle):
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    upright = np.random.default_rng(1).uniform(10, 30, (478, 2))
    upright[region.left], upright[region.right] = (12, 20), (28, 20)
    matrix = features_from_region(upright @ turn.T, region)
    cells = np.linalg.solve(matrix[:, :2], ((upright @ turn.T)[list(region.points)] - matrix[:, 2]).T).T
    np.testing.assert_allclose((cells.min(axis=0) + cells.max(axis=0)) / 2, CELLS / 2, atol=1e-6)
    np.testing.assert_allclose(np.ptp(cells, axis=0), CELLS / MARGIN, atol=1e-6)
    ends = [list(region.points).index(end) for end in (region.left, region.right)]
    left, right = cells[ends]
    assert right[0] > left[0] and abs(right[1] - left[1]) < 1e-6


def test_a_face_without_size_is_no_error():
    assert np.isfinite(features_from_region(np.ones((478, 2)), REGIONS[0])).all()


def small_graph() -> bytes:
    """y = -|x|, and z = y + x."""
    import flatbuffers
    from ai_edge_litert import schema_py_generated as schema

    def tensor(name):
        made = schema.TensorT()
        made.name, made.shape, made.type = name, [4], schema.TensorType.FLOAT32
        return made

    def operation(code, inputs, outputs):
        made = schema.OperatorT()
        made.opcodeIndex, made.inputs, made.outputs = code, inputs, outputs
        return made

    model, part = schema.ModelT(), schema.SubGraphT()
    kinds = (schema.BuiltinOperator.ABS, schema.BuiltinOperator.NEG, schema.BuiltinOperator.ADD)
    model.operatorCodes = []
    for kind in kinds:
        code = schema.OperatorCodeT()
        code.builtinCode = code.deprecatedBuiltinCode = kind
        model.operatorCodes.append(code)
    part.tensors = [tensor(name) for name in ("x", "|x|", "y", "z")]
    part.operators = [operation(0, [0], [1]), operation(1, [1], [2]), operation(2, [2, 0], [3])]
    part.operators[2].builtinOptionsType = schema.BuiltinOptions.AddOptions
    part.operators[2].builtinOptions = schema.AddOptionsT()
    part.inputs, part.outputs = [0], [3]
    model.version, model.subgraphs, model.buffers = 3, [part], [schema.BufferT()]
    builder = flatbuffers.Builder()
    builder.Finish(model.Pack(builder), b"TFL3")
    return bytes(builder.Output())


@needs_runtime
def test_parts_of_a_graph_give_what_the_whole_graph_gives():
    from carigs.detection.graph_cut import cut, read_graph
    from carigs.detection.network import Network

    content = small_graph()
    x = np.array([1, -2, 3, -4], np.float32)
    graph = read_graph(content)
    (whole,) = Network(content)(x)
    np.testing.assert_array_equal(whole, x - np.abs(x))
    (y,) = Network(cut(graph, [0], [2]))(x)
    np.testing.assert_array_equal(y, -np.abs(x))
    (z,) = Network(cut(graph, [2, 0], [3]))(y, x)
    np.testing.assert_array_equal(z, whole)
    middle, end = Network(cut(graph, [0], [1, 3]))(x)
    np.testing.assert_array_equal(middle, np.abs(x))
    np.testing.assert_array_equal(end, whole)
