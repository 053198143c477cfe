"""glTF 2.0 evaluated by its specification alone: accessors with sparse parts, animations, morph targets and skins."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

SIZES = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}
TYPES = {5126: "<f4", 5125: "<u4", 5123: "<u2"}


class Gltf:
    """A .glb file with one skinned mesh."""

    def __init__(self, file: Path):
        content = file.read_bytes()
        size = struct.unpack_from("<I", content, 12)[0]
        self.document = json.loads(content[20 : 20 + size])
        self.binary = content[28 + size :]
        self.mesh = self.document["meshes"][0]
        (self.primitive,) = self.mesh["primitives"]
        self.names = self.mesh["extras"]["targetNames"]
        self.base = self.array(self.primitive["attributes"]["POSITION"])
        self.targets = np.stack([self.array(target["POSITION"]) for target in self.primitive["targets"]])

    def view(self, index: int, kind: int, count: int, width: int) -> np.ndarray:
        view, dtype = self.document["bufferViews"][index], np.dtype(TYPES[kind])
        assert view["byteOffset"] % 4 == 0 and view["byteLength"] == count * width * dtype.itemsize
        return np.frombuffer(self.binary, dtype, count * width, view["byteOffset"]).reshape(count, width)

    def array(self, index: int) -> np.ndarray:
        entry = self.document["accessors"][index]
        width, count = SIZES[entry["type"]], entry["count"]
        if "bufferView" in entry:
            array = self.view(entry["bufferView"], entry["componentType"], count, width).astype(np.float64)
        else:
            array = np.zeros((count, width))
            sparse = entry["sparse"]
            moved, where = sparse["count"], sparse["indices"]
            places = self.view(where["bufferView"], where["componentType"], moved, 1)
            assert (np.diff(places[:, 0].astype(int)) > 0).all()
            array[places[:, 0]] = self.view(
                sparse["values"]["bufferView"], entry["componentType"], sparse["count"], width
            )
        if "min" in entry:
            np.testing.assert_allclose(array.min(axis=0), entry["min"])
            np.testing.assert_allclose(array.max(axis=0), entry["max"])
        return array

    def frame(self, animation: str | None, place: int) -> tuple[np.ndarray, dict[int, dict[str, np.ndarray]]]:
        """Weights, and translations and rotations of nodes, at a keyframe; None: without an animation."""
        weights = np.array(self.mesh["weights"])
        nodes = {i: dict(node) for i, node in enumerate(self.document["nodes"])}
        if animation is not None:
            (found,) = [one for one in self.document["animations"] if one["name"] == animation]
            for channel in found["channels"]:
                sampler = found["samplers"][channel["sampler"]]
                values = self.array(sampler["output"])
                count = self.document["accessors"][sampler["input"]]["count"]
                path, node = channel["target"]["path"], channel["target"]["node"]
                if path == "weights":
                    weights = values.reshape(count, -1)[place]
                else:
                    nodes[node][path] = values[place]
        return weights, nodes

    def vertices(self, animation: str | None = None, place: int = 0, **weights_by_name: float) -> np.ndarray:
        """World positions: morph targets, then linear blend skinning."""
        weights, nodes = self.frame(animation, place)
        for name, weight in weights_by_name.items():
            weights[self.names.index(name)] = weight
        shaped = self.base + np.einsum("k,kvc->vc", weights, self.targets)
        (skin,) = self.document["skins"]
        parents = {child: i for i, node in nodes.items() for child in node.get("children", ())}

        def world(i: int) -> np.ndarray:
            own = np.eye(4)
            own[:3, :3] = Rotation.from_quat(nodes[i].get("rotation", [0, 0, 0, 1])).as_matrix()
            own[:3, 3] = nodes[i].get("translation", 0)
            return world(parents[i]) @ own if i in parents else own

        inverse = self.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        transforms = np.stack([world(i) @ inverse[k] for k, i in enumerate(skin["joints"])])
        joints = self.array(self.primitive["attributes"]["JOINTS_0"]).astype(int)
        amounts = self.array(self.primitive["attributes"]["WEIGHTS_0"])
        homogeneous = np.pad(shaped, ((0, 0), (0, 1)), constant_values=1)
        moved = np.einsum("vkij,vj->vki", transforms[joints], homogeneous)[..., :3]
        return np.einsum("vk,vki->vi", amounts, moved)
