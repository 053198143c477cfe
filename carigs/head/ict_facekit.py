"""ICT-FaceKit Light (https://github.com/ICT-VGL/ICT-FaceKit, MIT): its folder of .obj files as a head model.

FaceKit has blendshapes alone. Joints are placed in proportion to the distance between the eyes; the jaw's skinning
weights follow from the blendshape that opens it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from carigs.errors import InputError
from carigs.head.joint_regression import regressor_row
from carigs.head.joint_transforms import rotation_matrices
from carigs.head.model import HeadModel
from carigs.head.region_geometry import FacialPoints, geometric_regions
from carigs.head.surface_points import SurfacePoints
from carigs.readers.arrays import checked_array
from carigs.readers.folders import listed
from carigs.readers.json_files import json_field, read_json
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.readers.mesh_files.obj import parse_obj
from carigs.readers.mesh_files.polygons import Polygons, triangulate_polygons

INDEX = "vertex_indices.json"
METRES_PER_UNIT = 0.01
VERTICES = 26719
PARTS = {"skin": (0, 14062), "left_eyeball": (21451, 22221), "right_eyeball": (23021, 23791)}
"""First and last + 1 vertex of the parts that are kept: face, head, neck, mouth and eye sockets; the scleras."""
ROOT, NECK, JAW = (0.0, -5.7, -2.9), (0.0, -4.1, -3.1), (0.0, -1.5, -2.4)
"""Joints, in units of half the distance between the eyes, from the point midway between the eyes."""
CHIN = slice(5, 12)
"""Landmarks that move with the bone of the jaw."""
LIP_CORNERS, INNER_LIPS = (54, 48), (62, 66)


def read_ict_facekit(folder: Path, track: Callable[[Iterable[Path]], Iterable[Path]] = iter) -> HeadModel:
    """Read the folder `FaceXModel` of ICT-FaceKit Light.

    Args:
        folder: Folder with `generic_neutral_mesh.obj`, `vertex_indices.json`, `identity000.obj` and the following, and
            one .obj for each expression that the .json names.
        track: Is given the files in the order in which they are read, to show progress.

    Returns:
        Head model with FLAME's joints, all identities and expressions of the folder, regions and landmarks; metres.

    Raises:
        InputError: If a file is missing, broken, or of another mesh.
    """
    folder = Path(folder)
    index = folder / INDEX
    content = read_json(index, dict)
    names = json_field(content, "expressions", list, file=index)
    are_names = all(isinstance(name, str) and name.isidentifier() for name in names)
    if not are_names or "jawOpen" not in names or len(set(names)) < len(names):  # each stands for a file
        raise InputError("expected names, among them jawOpen, each once", file=index, field="expressions")
    kept = np.concatenate([np.arange(*part) for part in PARTS.values()])
    new_ids = np.full(VERTICES, -1)
    new_ids[kept] = np.arange(len(kept))
    landmarks = new_ids[checked_array(content, "idx_to_landmark_verts", (68,), np.int64, below=VERTICES, file=index)]
    if (landmarks < 0).any():
        raise InputError("names vertices that are not skin", file=index, field="idx_to_landmark_verts")
    neutral_file = folder / "generic_neutral_mesh.obj"
    neutral = _mesh(neutral_file)
    faces = new_ids[triangulate_polygons(neutral, neutral_file)]
    faces = faces[(faces >= 0).all(axis=1)]
    template = neutral.vertices[kept]

    identities = listed(folder, "identity[0-9][0-9][0-9].obj")
    files = [*identities, *(folder / f"{name}.obj" for name in names)]
    shapedirs = np.stack([_mesh(file).vertices[kept] - template for file in track(files)], axis=2)
    parts = {name: new_ids[slice(*part)] for name, part in PARTS.items()}
    corners = template[landmarks[list(LIP_CORNERS)]]
    middle = template[landmarks[list(INNER_LIPS)]].mean(axis=0)
    points = FacialPoints(parts["left_eyeball"], parts["right_eyeball"], *corners, middle)
    regions = geometric_regions(template, faces, points, np.arange(len(template)) < len(parts["skin"]))
    if not regions:
        raise InputError("the eyes are not where they are in ICT-FaceKit Light", file=folder)
    joints, unit = _joints(template, parts)
    jaw_open = shapedirs[:, :, len(identities) + names.index("jawOpen")]
    return HeadModel(
        v_template=template.astype(np.float32),
        faces=faces.astype(np.int32),
        shapedirs=shapedirs.astype(np.float32),
        posedirs=np.zeros((len(template), 3, 0), np.float32),
        joint_regressor=_regressor(template, parts, joints, unit).astype(np.float32),
        weights=_weights(template, parts, joints, jaw_open, landmarks[CHIN]).astype(np.float32),
        parents=np.array([-1, 0, 1, 1, 1]),
        num_identity=len(identities),
        regions=regions,
        expression_names=tuple(names),
        landmarks68=SurfacePoints.at_vertices(landmarks),
    )


def _mesh(file: Path) -> Polygons:
    polygons = parse_obj(read_bytes(file, MAX_TEXT_BYTES, "mesh of ICT-FaceKit"), file)
    vertices, corners, _ = polygons
    if len(vertices) != VERTICES:
        raise InputError(f"{len(vertices)} vertices, ICT-FaceKit Light has {VERTICES}", file=file)
    if corners.max(initial=0) >= VERTICES or not np.isfinite(vertices).all():
        raise InputError("a vertex is not finite, or a face names one that does not exist", file=file)
    return polygons._replace(vertices=METRES_PER_UNIT * vertices)


def _joints(
    template: Float[np.ndarray, "v 3"], parts: dict[str, Int[np.ndarray, " _"]]
) -> tuple[Float[np.ndarray, "5 3"], float]:
    """Positions of the joints, and half the distance between the eyes."""
    left, right = (template[parts[f"{side}_eyeball"]].mean(axis=0) for side in ("left", "right"))
    unit = float(np.linalg.norm(left - right)) / 2
    return np.array([*((left + right) / 2 + unit * np.array([ROOT, NECK, JAW])), left, right]), unit


def _regressor(
    template: Float[np.ndarray, "v 3"],
    parts: dict[str, Int[np.ndarray, " _"]],
    joints: Float[np.ndarray, "5 3"],
    unit: float,
) -> Float[np.ndarray, "5 v"]:
    """Eyes are the means of their eyeballs; the others follow the skin at their height."""
    is_skin = np.arange(len(template)) < len(parts["skin"])
    rows = [
        regressor_row(template, is_skin & (np.abs(template[:, 1] - joint[1]) < 0.6 * unit), joint)
        for joint in joints[:3]
    ]
    for side in ("left", "right"):
        rows.append(np.isin(np.arange(len(template)), parts[f"{side}_eyeball"]) / len(parts[f"{side}_eyeball"]))
    return np.stack(rows)


def _weights(
    template: Float[np.ndarray, "v 3"],
    parts: dict[str, Int[np.ndarray, " _"]],
    joints: Float[np.ndarray, "5 3"],
    jaw_open: Float[np.ndarray, "v 3"],
    chin: Int[np.ndarray, " _"],
) -> Float[np.ndarray, "v 5"]:
    """Skinning weights: the jaw's are the shares of its rotation that the blendshape `jawOpen` gives to the vertices.

    The rotation is about the jaw joint's axis from left to right, by the angle that moves the chin as `jawOpen` does.
    """
    arm = template - joints[2]

    def turned(angle: float) -> Float[np.ndarray, "v 3"]:
        return arm @ rotation_matrices(np.array([angle, 0.0, 0.0])).T - arm

    angles = np.linspace(0, 0.8, 401)
    errors = [np.linalg.norm(turned(angle)[chin] - jaw_open[chin]) for angle in angles]
    rotation = turned(angles[int(np.argmin(errors))])
    squared = (rotation**2).sum(axis=1)
    jaw = np.clip((jaw_open * rotation).sum(axis=1) / np.maximum(squared, 1e-12), 0, 1)
    low, high = joints[0, 1], joints[1, 1]  # the neck joint takes over between the root and itself
    t = np.clip((template[:, 1] + 0.35 * (template[:, 2] - joints[0, 2]) - low) / (high - low), 0, 1)
    head = t * t * (3 - 2 * t)
    weights = np.stack([1 - head, head * (1 - jaw), head * jaw, 0 * head, 0 * head], axis=1)
    for column, side in ((3, "left"), (4, "right")):
        weights[parts[f"{side}_eyeball"]] = np.eye(5)[column]
    return weights
