"""The outer skin of a head, and the rims of its openings: the edges of the lids, and the lips where they meet.

Whoever looks at a face sees its outer skin: eye sockets, the bag of the mouth, teeth and nostrils are hidden. Where the
skin that is seen ends, there is a rim. Lids and lips are round: their rims are where observers to all sides of the
front still see them, as the images that landmarks are found in do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.errors import MeshError
from carigs.mesh.ray_caster import RayCaster
from carigs.mesh.triangle_mesh import barycenters, components, face_normals, size, unique_edges

OBLIQUE = 25.0
RIM_VIEWS = ((0.0, 0.0), (OBLIQUE, 0.0), (-OBLIQUE, 0.0), (0.0, OBLIQUE), (0.0, -OBLIQUE))
"""Yaw and pitch in degrees of the observers who must all see the skin up to a rim."""
SKIN_VIEWS = (*((yaw, 0.0) for yaw in (-75.0, -50.0, -25.0, 0.0, 25.0, 50.0, 75.0)), (0.0, -35.0), (0.0, 25.0))
"""Those of whom one must see a triangle of the outer skin."""
LEAST_COSINE = 0.05
"""Triangles at more than 87 degrees to an observer's line of sight do not count as seen."""
LIFT = 1e-5
"""Distance of the rays' origins from the surface, in sizes of the mesh."""
EYE_REACH, MOUTH_SIDE, MOUTH_HEIGHT = 0.9, 1.2, (-3.2, -1.2)
"""Where rims are, in half distances between the eyes: around an eye; beside the middle, and above the eyes."""

Belongs = Callable[[Float[np.ndarray, "n 3"]], bool]


@dataclass(frozen=True)
class OuterSkin:
    """The skin of a face that can be seen."""

    faces: Bool[np.ndarray, " f"]
    """Whether each triangle belongs to it."""
    rims: dict[str, Float[np.ndarray, "_ 3"]]
    """Closed polygons around `left_eye`, `right_eye` (of the subject) and `mouth`; one that is closed has none."""
    nose_tip: Float[np.ndarray, "3"]


def outer_skin(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    candidates: Bool[np.ndarray, " f"],
    eyes: Float[np.ndarray, "2 3"],
) -> OuterSkin:
    """Find the outer skin of a head that looks to +z, with +y up.

    Args:
        vertices: Vertices in any unit.
        faces: Triangles, outside by the right-hand rule.
        candidates: Triangles that may be skin: not those of the eyeballs. The others hide what is behind them.
        eyes: Centres of the left and the right eyeball, in the unit of the vertices.

    Returns:
        The skin.

    Raises:
        MeshError: If nothing lies where the nose is.
    """
    middle, unit = eyes.mean(axis=0), np.linalg.norm(eyes[0] - eyes[1]) / 2
    p, left, right = (vertices - middle) / unit, *((eyes - middle) / unit)
    on_nose = (np.abs(p[:, 0]) < 0.4) & (p[:, 1] < 0) & (p[:, 1] > -2) & np.isin(np.arange(len(p)), faces[candidates])
    if not on_nose.any():
        raise MeshError("there is no nose below the eyes and between them: a head looks to +z, with +y up")
    tip = int(np.argmax(np.where(on_nose, p[:, 2], -np.inf)))
    caster = RayCaster(vertices, faces)
    seen = {view: _seen(caster, vertices, view) for view in {*RIM_VIEWS, *SKIN_VIEWS}}
    up_to_rims = _part_of(tip, faces, candidates & np.all([seen[view] for view in RIM_VIEWS], axis=0))
    skin = _part_of(tip, faces, candidates & np.any([seen[view] for view in SKIN_VIEWS], axis=0))
    borders = _borders(faces[up_to_rims])
    places = {"left_eye": _around(left), "right_eye": _around(right), "mouth": _is_mouth}
    inside = {name: [rim for rim in borders if belongs(p[rim])] for name, belongs in places.items()}
    rims = {name: vertices[max(found, key=lambda rim: np.ptp(p[rim, 0]))] for name, found in inside.items() if found}
    return OuterSkin(skin, rims, vertices[tip])


def _around(eye: Float[np.ndarray, "3"]) -> Belongs:
    return lambda rim: bool((np.linalg.norm((rim - eye)[:, :2], axis=1) < EYE_REACH).all())


def _is_mouth(rim: Float[np.ndarray, "n 3"]) -> bool:
    x, y = rim[:, 0], rim[:, 1]
    crosses = -MOUTH_SIDE < x.min() < 0 < x.max() < MOUTH_SIDE
    return bool(crosses and MOUTH_HEIGHT[0] < y.min() and y.max() < MOUTH_HEIGHT[1])


def _seen(caster: RayCaster, vertices: Float[np.ndarray, "v 3"], view: tuple[float, float]) -> Bool[np.ndarray, " f"]:
    """Triangles whose centre is seen by a distant observer at this yaw and pitch."""
    yaw, pitch = np.radians(view)
    direction = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    normals = face_normals(vertices, caster.faces)
    towards = np.flatnonzero(normals @ direction > LEAST_COSINE)
    centres = barycenters(vertices, caster.faces)[towards] / size(vertices, caster.faces)
    hit = caster.first_hit(centres + LIFT * normals[towards], np.tile(direction, (len(towards), 1)))[0]
    seen = np.zeros(len(caster.faces), bool)
    seen[towards[hit < 0]] = True
    return seen


def _part_of(vertex: int, faces: Int[np.ndarray, "f 3"], chosen: Bool[np.ndarray, " f"]) -> Bool[np.ndarray, " f"]:
    """Those of the chosen triangles that hang together with a vertex."""
    label = components(faces[chosen], int(faces.max()) + 1)
    return chosen & (label[faces[:, 0]] == label[vertex])


def _borders(faces: Int[np.ndarray, "f 3"]) -> list[Int[np.ndarray, " _"]]:
    """Borders of a surface, each as a closed chain of vertices."""
    edges, count = unique_edges(faces)
    ahead: dict[int, list[int]] = {}
    for i, j in edges[count == 1].tolist():
        ahead.setdefault(i, []).append(j)
        ahead.setdefault(j, []).append(i)
    borders = []
    for start in ahead:
        chain = [start]
        while ahead[chain[-1]]:  # each vertex has an even number of edges: a walk ends where it began
            step = ahead[chain[-1]].pop()
            ahead[step].remove(chain[-1])
            chain.append(step)
            if step == start:
                borders.append(np.array(chain[1:]))
                chain = [start]
    return borders
