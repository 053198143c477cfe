"""The readers of files from outside, a sound file for each, and a summary of what they return."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
import trimesh
from safetensors.torch import save_file

from carigs.capture import Capture, Frame
from carigs.capture.capture_json import camera_to_json
from carigs.capture.frame_index import read_frame_index, read_ground_truth, write_frame_index, write_ground_truth
from carigs.capture.images import write_png
from carigs.capture.target_index import FACE_FLAGS, read_targets, write_targets
from carigs.config import compose, compose_study, load_settings, settings_text
from carigs.exaggeration.gamma_path import straight_path
from carigs.hair import FoundHair, hair_shadow, load_hair
from carigs.hair.hull import Voxels
from carigs.hair.strands import Strands
from carigs.head import HeadModel, HeadParameters, flame_joints, neutral, pose, read_subject_path
from carigs.light import Shading, fibonacci_sphere
from carigs.light.shading import load_shading, save_shading
from carigs.readers.images import read_header, read_pixels
from carigs.readers.json_files import read_json
from carigs.readers.mesh_files.meshes import FORMATS, read_mesh
from carigs.readers.mesh_files.obj import read_obj_uvs
from carigs.readers.npz import read_npy, read_npz
from carigs.readers.pickles import read_pickle, read_pickled_npy
from carigs.readers.weights import read_weights
from carigs.splat.avatar import Avatar, load_avatar, save_avatar
from carigs.splat.formats.flame_param import read_flame_param
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.rig.smooth_motion import SmoothMotion
from carigs.splat.surfels.ply import read_ply, write_ply
from carigs.splat.surfels.surfels import flat_discs
from carigs.system.files import write_json
from carigs.toy import load_subject
from evaluation.tables.frame_records import FrameRecord, read_frame_records, write_frame_records
from evaluation.tables.metric_records import MetricRecord, StudyPoint
from evaluation.tables.summary import read_metrics
from stress.sound_files import captures, domes, heads, splats
from stress.sound_files.ball import CAMERA, FACES, VERTICES, gnm_arrays, head_model


def sound_files(folder: Path) -> dict[str, bytes]:
    """Write a sound file for every reader.

    Args:
        folder: Where they are written.

    Returns:
        Content of the file of each reader.
    """
    random, model, n = np.random.default_rng(1), head_model(), 40
    arrays = {"v": random.normal(size=(6, 3)).astype(np.float32), "f": np.arange(6).reshape(2, 3)}
    path = straight_path(VERTICES.astype(float), FACES, 0.1 * VERTICES.astype(float), 0.25)
    shading = Shading(fibonacci_sphere(8), np.ones((9, 3)), 1.0, 2.0, np.zeros(len(FACES), bool))
    surfels = flat_discs(
        random.integers(0, len(FACES), n), random.normal(0, 0.3, (n, 3)), random.random(n) + 0.1, 0.6,
        random.random((n, 3)), 1,
    )  # fmt: skip
    np.savez(folder / "a.npz", **arrays, name=np.array("head"))
    np.save(folder / "a.npy", arrays["v"])
    flame = {
        "v_template": VERTICES, "f": FACES.astype(np.uint32), "shapedirs": model.shapedirs, "posedirs": model.posedirs,
        "J_regressor": model.joint_regressor, "weights": model.weights,
        "kintree_table": np.stack([model.parents, np.arange(5)]),
    }  # fmt: skip
    (folder / "a.pkl").write_bytes(pickle.dumps({**arrays, "name": "head"}, 2))
    (folder / "flame.pkl").write_bytes(pickle.dumps(flame, 2))
    np.savez(folder / "gnm_head.npz", **gnm_arrays())
    np.save(folder / "landmarks.npy", {"full_lmk_faces_idx": np.arange(9)[None], "name": "head"})
    corners = "\n".join(f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in FACES[:20] + 1)
    uvs = "\n".join(f"vt {u:.4f} {v:.4f}" for u, v in VERTICES[:, :2])
    (folder / "uvs.obj").write_text(f"{uvs}\n{corners}\n")
    model.save(folder / "head_model.npz")
    parameters = HeadParameters(expression=random.normal(size=100), joints=flame_joints(jaw=[0.1, 0, 0]))
    parameters.save(folder / "parameters.npz", model)
    pixels = (random.random((24, 32, 3)) * 255).astype(np.uint8)
    (folder / "a.png").write_bytes(cv2.imencode(".png", pixels)[1].tobytes())
    (folder / "a.jpg").write_bytes(cv2.imencode(".jpg", pixels)[1].tobytes())
    write_ply(folder / "surfels.ply", surfels)
    solid = trimesh.creation.icosahedron()
    embedded = trimesh.exchange.gltf.export_gltf(solid.scene(), embed_buffers=True)
    for suffix in FORMATS:
        exported = embedded["model.gltf"] if suffix == ".gltf" else solid.export(file_type=suffix[1:])
        (folder / f"mesh{suffix}").write_bytes(exported.encode() if isinstance(exported, str) else exported)
    state = {"a.weight": torch.arange(60.0).reshape(20, 3), "a.bias": torch.zeros(20)}
    torch.save(state, folder / "net.pt")
    torch.save(state, folder / "legacy.pth", _use_new_zipfile_serialization=False)
    save_file(state, folder / "net.safetensors")
    (folder / "train.yaml").write_text(settings_text("train"))
    path.save(folder / "path.npz")
    save_shading(folder / "shading.npz", shading)
    covered = np.arange(len(FACES)) < 5
    volume = Voxels(VERTICES.astype(np.float32), np.full(len(VERTICES), 0.5, np.float32), 0.004)
    visible = np.ones(len(VERTICES), np.float32)
    upwards = np.tile(np.float32([0, 1, 0]), (len(VERTICES), 1))
    strands = Strands(upwards, visible, -upwards)
    texture = 0.1 * covered.astype(np.float32)
    hair = FoundHair(texture, covered, covered, ~covered, volume, visible, strands)
    hair.save(folder / "hair.npz")
    sequence = HeadSequence(model, {0: parameters}, path)
    sequence.shading = shading
    sequence.hair_shadow = hair_shadow(hair, covered, sequence.rig.vertices, sequence.rig.faces, 30.0)
    sequence.smooth = SmoothMotion(sequence.rig, np.arange(len(FACES)) < 9)
    save_avatar(folder / "avatar.npz", Avatar(surfels, sequence))
    frame = Frame(0, 0, "EXP-1", "train", "a.png", "a.png", "parameters.npz", 0)
    capture = Capture(folder, folder / "head_model.npz", (frame,), (CAMERA,), 1.0)
    capture.save(folder / "capture.json")
    np.save(folder / FACE_FLAGS, np.zeros(len(FACES), np.uint16))
    target = {"timestep": 0, "camera": 0, "image": "a.png", "mask_flags": "a.png", "weight": 1.0}
    write_targets(folder / "targets.json", 0.25, folder, [target], [])
    entry = {"protocol": "test", "timestep": 0, "camera": 0, "sequence": "EXP-1", "file": "a.png"}
    write_frame_index(folder / "frames.json", [entry, {**entry, "protocol": "orbit", "view": camera_to_json(CAMERA)}])
    write_json(folder / "a.json", {"frames": [{"w": 1, "m": [0.5, -2e3], "s": "text"}], "n": None})
    write_png(folder / "00000_00.png", np.ones((24, 32, 3)))
    write_png(folder / "00000_00_mask.png", np.ones((24, 32)))
    write_ground_truth(folder / "truth.json", 0.25, [(0, 0)])
    record = "study,subject,variant,0,0.25,0.1,files,test,0,3,full,psnr,25.5,"
    (folder / "metrics.csv").write_text(",".join(MetricRecord._fields) + f"\n{record}\n{record}\n")
    geometry = FrameRecord("test", None, 3, "full", "exaggeration_gain", 0.5, "")
    write_frame_records(folder / "geometry.csv", [geometry, geometry._replace(camera=2, metric="hole_rate")])
    np.savez(folder / "subject.npz", **_subject(random))
    for others in (captures, domes, splats, heads):
        others.write_sound_files(folder)
    return {reader: (folder / name).read_bytes() for reader, (_, name) in READERS.items() if reader != "override"}


def _subject(random: np.random.Generator) -> dict[str, np.ndarray]:
    """The arrays of a toy subject with one texel triangle per face, four strands and two teeth."""
    f, face = len(FACES), np.array([0, 1, 5, 7])
    return {
        "shape": np.zeros(300), "supersampling": np.array(2), "exposure": np.ones(len(VERTICES), np.float32),
        "atlas.first": 3 * np.arange(f), "atlas.resolution": np.ones(f, int),
        "atlas.texels": random.integers(0, 256, (3 * f, 4)).astype(np.uint8),
        "strands.face": face, "strands.barycentric": np.full((4, 3), 1 / 3),
        "strands.local": random.random((4, 8, 3)).astype(np.float32), "strands.width": np.ones(4, np.float32),
        "strands.colour": np.ones((4, 3), np.float32), "strands.shade": np.ones((4, 8), np.float32),
        "teeth": random.random((6, 3)).astype(np.float32), "teeth_faces": np.arange(6, dtype=np.int32).reshape(2, 3),
        "teeth_colours": np.ones((6, 3), np.float32), "upper_teeth": np.array(3),
        "long_hair": np.array(False),
    }  # fmt: skip


def _avatar(file: Path) -> Any:
    """The avatar's image: what is read must also render."""
    avatar = load_avatar(file)
    image = avatar.render(min(avatar.sequence.parameters), 0.1, CAMERA)
    if not np.isfinite(image).all():
        raise AssertionError("the image is not finite")
    return image


def _posed(file: Path) -> Any:
    model = HeadModel.load(file)
    vertices = pose(model, HeadParameters.zeros(model))
    return model, vertices


def _parameters(file: Path) -> Any:
    parameters = HeadParameters.load(file, head_model())
    return parameters, neutral(head_model(), parameters), pose(head_model(), parameters)


def _override(text: str) -> Any:
    compose.cache_clear()
    return compose_study(text)


READERS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "npz": (read_npz, "a.npz"),
    "npy": (read_npy, "a.npy"),
    "json": (read_json, "a.json"),
    "pickle": (read_pickle, "a.pkl"),
    "pickled npy": (read_pickled_npy, "landmarks.npy"),
    "png": (read_pixels, "a.png"),
    "jpg": (read_pixels, "a.jpg"),
    "size of png": (read_header, "a.png"),
    "size of jpg": (read_header, "a.jpg"),
    "surfels": (read_ply, "surfels.ply"),
    **{f"mesh{suffix}": (read_mesh, f"mesh{suffix}") for suffix in FORMATS},
    "pt": (read_weights, "net.pt"),
    "legacy": (read_weights, "legacy.pth"),
    "safetensors": (read_weights, "net.safetensors"),
    "settings": (lambda file: load_settings("train", file), "train.yaml"),
    "path": (lambda file: read_subject_path(file, head_model()).at(0.1), "path.npz"),
    "shading": (lambda file: load_shading(file, len(FACES)), "shading.npz"),
    "hair": (lambda file: load_hair(file, len(FACES)), "hair.npz"),
    "texture coordinates": (read_obj_uvs, "uvs.obj"),
    "head model": (_posed, "head_model.npz"),
    "gnm": (_posed, "gnm_head.npz"),
    "flame": (_posed, "flame.pkl"),
    "parameters": (_parameters, "parameters.npz"),
    "flame_param": (lambda file: read_flame_param(file, head_model()), "parameters.npz"),
    "avatar": (_avatar, "avatar.npz"),
    "capture": (Capture.load, "capture.json"),
    "targets": (lambda file: read_targets(file, Capture.load(file.with_name("capture.json"))), "targets.json"),
    "frames": (read_frame_index, "frames.json"),
    "truth": (read_ground_truth, "truth.json"),
    "geometry": (
        lambda file: read_frame_records(file, StudyPoint("s", "a", "v", 0, 0.25, 0.1, "files")),
        "geometry.csv",
    ),
    "metrics": (lambda file: [record.tolist() for record in read_metrics([file]).to_numpy()], "metrics.csv"),
    "subject": (lambda file: load_subject(file.parent), "subject.npz"),
    **captures.READERS,
    **domes.READERS,
    **splats.READERS,
    **heads.READERS,
    "override": (_override, ""),
}
"""Function and file name of each reader."""


def summary(value: Any) -> str:
    """Digest of what a reader returns: equal values have equal digests.

    Args:
        value: Arrays, numbers, texts, and collections and dataclasses of them.

    Returns:
        Hexadecimal digits.
    """
    digest = hashlib.sha256()
    _add(value, digest)
    return digest.hexdigest()


def _add(value: Any, digest: Any) -> None:
    if isinstance(value, Mapping):
        value = sorted(value.items(), key=lambda item: str(item[0]))
    elif isinstance(value, torch.Tensor):
        value = value.detach().numpy()
    elif isinstance(value, trimesh.Trimesh):
        value = (np.asarray(value.vertices), np.asarray(value.faces))
    elif is_dataclass(value):
        value = [(f.name, getattr(value, f.name)) for f in fields(value)]
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, list | tuple):
        for item in value:
            _add(item, digest)
    else:
        digest.update(repr(value).encode())
