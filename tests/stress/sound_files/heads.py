"""Landmarks and embeddings, ICT-FaceKit's folder, and downloads of head models."""

from __future__ import annotations

import io
import shutil
import urllib.request
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from carigs.capture import Capture, Frame
from carigs.fitting.landmarks.embedding import read_embedding
from carigs.fitting.landmarks.files import read_landmarks
from carigs.fitting.landmarks.providers import find_landmarks
from carigs.head import HeadModel
from carigs.head.download import GNM, fetch_head
from carigs.head.ict_facekit import read_ict_facekit
from carigs.toy.rig.head_model import head_model as toy_head
from stress.sound_files.ball import CAMERA, FACES, gnm_arrays, head_model
from stress.sound_files.facekit import write_facekit

POINTS = 5


def write_sound_files(folder: Path) -> None:
    """Write a sound file for every reader of landmarks and heads.

    Args:
        folder: Where they are written.
    """
    random = np.random.default_rng(7)
    values = random.random((2, 1, POINTS, 3))
    np.savez(folder / "landmarks.npz", landmarks=values, timesteps=np.arange(2), cameras=np.zeros(1, int))
    (folder / "landmarks").mkdir()
    for t in range(2):
        np.savez(folder / f"landmarks/{t:05d}_00.npz", landmarks=values[t, 0])
    (folder / "face_landmarker.task").write_bytes(b"PK\x05\x06" + bytes(18))
    faces = np.arange(POINTS)
    np.savez(folder / "embedding.npz", faces=faces, barycentric=np.full((POINTS, 3), 1 / 3))
    np.savez(folder / "vertex_embedding.npz", vertices=FACES[:POINTS, 0])
    (folder / "FaceXModel").mkdir()
    write_facekit(folder / "FaceXModel", toy_head(), 1, {"jawOpen": "jaw_open"})
    np.savez(folder / "served.npz", **gnm_arrays())
    (folder / "gnm.npz.sha256").write_text(_fetched(folder / "served.npz") + "  gnm.npz\n")


@cache
def _footage(folder: Path) -> Capture:
    frames = tuple(Frame(t, 0, "", "train", f"{t}.png", None, "", 0) for t in range(2))
    return Capture(folder, folder / "none.npz", frames, (CAMERA,), 1.0)


def _fetched(file: Path) -> str:
    """What `carigs head fetch` makes of a file that a server sends."""
    response = io.BytesIO(file.read_bytes())
    response.geturl = lambda: GNM.url
    response.status, response.headers = 200, {}
    with patch.object(urllib.request, "urlopen", lambda *_, **__: response):
        return fetch_head(GNM.url, file.with_name("gnm.npz"))


def _served(file: Path) -> Any:
    """The download alone: nothing is kept from before."""
    folder = file.with_name("downloads")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    shutil.copyfile(file, folder / "served.npz")
    return _fetched(folder / "served.npz"), HeadModel.load(folder / "gnm.npz")


READERS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "landmarks": (read_landmarks, "landmarks.npz"),
    "landmarks of a frame": (lambda file: find_landmarks(file.parent, _footage(file.parent)), "landmarks/00001_00.npz"),
    "embedding": (lambda file: read_embedding(file, head_model(), POINTS), "embedding.npz"),
    "embedding of vertices": (lambda file: read_embedding(file, head_model(), POINTS), "vertex_embedding.npz"),
    "facekit index": (lambda file: read_ict_facekit(file.parent), "FaceXModel/vertex_indices.json"),
    "facekit mesh": (lambda file: read_ict_facekit(file.parent), "FaceXModel/generic_neutral_mesh.obj"),
    "facekit expression": (lambda file: read_ict_facekit(file.parent), "FaceXModel/jawOpen.obj"),
    "download": (_served, "served.npz"),
    "kept checksum": (lambda file: _fetched(file.with_name("served.npz")), "gnm.npz.sha256"),
}
"""Function and file of each reader."""
