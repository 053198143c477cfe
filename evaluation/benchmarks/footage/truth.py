"""What is known of every frame of synthetic footage: the head and the cameras."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from carigs.capture.camera import Camera
from carigs.head import HeadModel, HeadParameters
from carigs.head.posing import pose_frames
from carigs.readers.npz import read_npz
from carigs.system.files import writing

FILE, MODEL = "truth.npz", "head_model.npz"
PER_FRAME = ("translation", "rotation", "joints", "expression")


@dataclass(frozen=True)
class FootageTruth:
    """The truth of t timesteps seen by c cameras, in metres."""

    model: HeadModel
    parameters: list[HeadParameters]
    """Of each timestep; all of one identity."""
    cameras: list[list[Camera]]
    """Of each timestep, then of each camera: they may move."""
    fps: float

    def vertices(self) -> Float[np.ndarray, "t v 3"]:
        """The posed head.

        Returns:
            World points of each timestep.
        """
        return pose_frames(self.model, self.parameters)

    def world_from_head(self) -> Float[np.ndarray, "t 3 3"]:
        """How the head is turned: the root and the neck together.

        Returns:
            A rotation of each timestep.
        """
        turns = Rotation.from_rotvec([p.rotation for p in self.parameters])
        return (turns * Rotation.from_rotvec([p.joints[0] for p in self.parameters])).as_matrix()

    def camera_from_head(self, camera: int) -> Float[np.ndarray, "t 3 3"]:
        """How the head is turned as a camera sees it.

        Args:
            camera: Number of the camera.

        Returns:
            A rotation of each timestep, into OpenCV axes.
        """
        cameras = np.array([seen[camera].camera_from_world[:3, :3] for seen in self.cameras])
        return cameras @ self.world_from_head()

    def save(self, folder: Path) -> None:
        """Write `truth.npz`, and the head model.

        Args:
            folder: Where to write.
        """
        first = self.cameras[0]
        arrays = {name: np.array([getattr(p, name) for p in self.parameters]) for name in PER_FRAME}
        arrays |= {
            "shape": self.parameters[0].shape,
            "camera_from_world": np.array([[c.camera_from_world for c in seen] for seen in self.cameras]),
            "intrinsics": np.array([c.intrinsics for c in first]),
            "size": np.array([(c.width, c.height) for c in first]),
            "fps": np.array(self.fps),
        }
        if self.parameters[0].static_offset is not None:
            arrays["static_offset"] = self.parameters[0].static_offset
        with writing(folder / FILE) as part:
            np.savez_compressed(part, **arrays)
        with writing(folder / MODEL) as part:
            self.model.save(part)

    @classmethod
    def load(cls, folder: Path) -> FootageTruth:
        """Read what `save` has written.

        Args:
            folder: Where it lies.

        Returns:
            The truth.

        Raises:
            InputError: If a file is missing or damaged.
        """
        arrays = read_npz(folder / FILE, "truth of footage")
        shared = {name: arrays[name] for name in ("shape", "static_offset") if name in arrays}
        parameters = [
            HeadParameters(**{name: arrays[name][t] for name in PER_FRAME}, **shared)
            for t in range(len(arrays["rotation"]))
        ]
        cameras = [
            [
                Camera(pose, *lens, *map(int, size))
                for pose, lens, size in zip(poses, arrays["intrinsics"], arrays["size"], strict=True)
            ]
            for poses in arrays["camera_from_world"]
        ]
        model = HeadModel.load(folder / MODEL)
        return cls(model, parameters, cameras, float(arrays["fps"]))
