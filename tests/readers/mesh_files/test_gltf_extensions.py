"""Extensions of GLB: quantised positions are read; what changes the triangles and is not read is named."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from carigs.errors import CarigsWarning, InputError
from carigs.readers.mesh_files.glb import parse_glb
from tests.readers.mesh_files.test_glb import FACES, VERTICES, document, glb


def quantised(dtype, normalized, scale):
    """The tetrahedron with whole numbers as positions; the node scales and moves them back."""
    info = np.iinfo(dtype)
    span = info.max if normalized else 100
    rows = np.zeros((4, 4), np.dtype(dtype).newbyteorder("<"))  # positions are aligned to 4 bytes
    rows[:, :3] = np.round(VERTICES * span)
    content = document()
    content |= {"extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"]}
    kind = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123}[dtype]
    content["accessors"][0] |= {"componentType": kind, "normalized": normalized}
    content["bufferViews"][0] |= {"byteLength": rows.nbytes, "byteStride": rows.strides[0]}
    content["bufferViews"][1]["byteOffset"] = rows.nbytes
    content["buffers"][0]["byteLength"] = rows.nbytes + FACES.nbytes
    content["nodes"] = [{"mesh": 0, "scale": [scale if normalized else scale / 100] * 3, "translation": [1, 2, 3]}]
    return glb(content, rows.tobytes() + FACES.tobytes())


@pytest.mark.parametrize("dtype", ["int8", "uint8", "int16", "uint16"])
@pytest.mark.parametrize("normalized", [True, False])
def test_quantised_positions_are_read(dtype, normalized):
    vertices, faces = parse_glb(quantised(dtype, normalized, 0.25), "a.glb")
    np.testing.assert_allclose(vertices, 0.25 * VERTICES + [1, 2, 3], atol=1e-12)
    np.testing.assert_array_equal(faces, FACES)


def test_the_smallest_normalised_number_is_minus_one():
    """glTF 2.0, section 3.11: -128 and -127 of a byte stand for the same."""
    content = quantised("int8", True, 1.0)
    at = content.index(bytes([0, 0, 0, 0, 127]))
    for byte in (128, 129):
        changed = content[:at] + bytes([byte]) + content[at + 1 :]
        np.testing.assert_allclose(parse_glb(changed, "a.glb")[0][0], [0, 2, 3], atol=1e-12)


def draco(content):
    """As Draco's encoder leaves it: accessors without data."""
    for accessor in content["accessors"]:
        del accessor["bufferView"]
    content["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0}}


def meshopt(name):
    def change(content):
        for view in content["bufferViews"]:
            view["extensions"] = {name: {"buffer": 0, "byteLength": 96, "mode": "ATTRIBUTES"}}
            view["buffer"] = 1
        content["buffers"] += [{"byteLength": 96, "extensions": {name: {"fallback": True}}}]

    return change


COMPRESSED = {
    "KHR_draco_mesh_compression": draco,
    "EXT_meshopt_compression": meshopt("EXT_meshopt_compression"),
    "KHR_meshopt_compression": meshopt("KHR_meshopt_compression"),
}


@pytest.mark.parametrize("name", COMPRESSED)
@pytest.mark.parametrize("lists", [{"extensionsUsed", "extensionsRequired"}, {"extensionsUsed"}, set()])
def test_a_compression_is_named_whether_it_is_listed_or_not(name, lists):
    content = document() | {key: [name] for key in lists}
    COMPRESSED[name](content)
    says = rf"a\.glb: .*needs the extension {name}, which is not read; save the mesh without compression"
    with pytest.raises(InputError, match=says):
        parse_glb(glb(content), "a.glb")


@pytest.mark.parametrize("name", ["EXT_mesh_gpu_instancing", "KHR_gaussian_splatting", "VENDOR_secret", "x" * 5000])
def test_a_required_extension_that_is_not_known_is_named(name):
    content = document() | {"extensionsRequired": [name]}
    with pytest.raises(InputError, match=rf"a\.glb: extensionsRequired: needs the extension {name[:60]}") as raised:
        parse_glb(glb(content), "a.glb")
    assert len(str(raised.value)) < 200


@pytest.mark.parametrize(
    "name",
    [
        "KHR_materials_unlit", "KHR_texture_transform", "KHR_texture_basisu", "EXT_texture_webp", "KHR_lights_punctual",
        "KHR_xmp", "KHR_xmp_json_ld", "EXT_materials_bump", "EXT_lights_ies", "KHR_audio_emitter", "VRMC_vrm",
    ],
)  # fmt: skip
def test_extensions_of_what_is_ignored_do_no_harm(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        content = document() | {"extensionsUsed": [name], "extensionsRequired": [name]}
        np.testing.assert_array_equal(parse_glb(glb(content), "a.glb")[0], VERTICES)


@pytest.mark.parametrize("name", ["EXT_mesh_gpu_instancing", "KHR_node_visibility", "MSFT_lod"])
def test_an_extension_that_would_show_other_triangles_is_warned_of(name):
    with pytest.warns(CarigsWarning, match=rf"a\.glb: .* \({name}\)"):
        parse_glb(glb(document() | {"extensionsUsed": [name]}), "a.glb")


@pytest.mark.parametrize("value", ["KHR_draco_mesh_compression", {"a": 1}, 3])
def test_a_list_of_extensions_is_a_list(value):
    with pytest.raises(InputError, match=r"a\.glb: extensionsRequired: expected a list"):
        parse_glb(glb(document() | {"extensionsRequired": value}), "a.glb")


def test_compressed_data_with_plain_data_beside_them_are_read():
    """A compression that a file uses and does not require: its accessors have data of their own."""
    content = document() | {"extensionsUsed": ["KHR_draco_mesh_compression"]}
    content["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 7}}
    np.testing.assert_array_equal(parse_glb(glb(content), "a.glb")[1], FACES)
