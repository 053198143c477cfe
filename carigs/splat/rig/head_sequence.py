"""A head over time and its caricature: posed meshes at any timestep and level, and the motion of their triangles."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float32, UInt8

from carigs.capture import Capture
from carigs.errors import InputError
from carigs.exaggeration import Caricature, GammaPath
from carigs.hair import HairShadow
from carigs.head import HeadModel, HeadParameters, pose, subject_model
from carigs.light.shading import Shading
from carigs.light.transfer import Transfer
from carigs.splat.rig.face_motion import FaceMotion
from carigs.splat.rig.rig import Rig, build_rig, face_motion
from carigs.splat.rig.smooth_motion import SmoothMotion
from carigs.splat.rig.solid_motion import SolidMotion


@dataclass
class HeadSequence:
    """A subject's head, its parameters over time, and its caricature; motions are cached up to a budget of memory.

    Attributes:
        head: Head model with identity and static offset baked into the template, which is the canonical mesh.
        parameters: Head parameters of every timestep, without shape and static offset.
        path: Caricatures of the head at every level.
        megabytes: Budget of the cached motions.
        shading: How colours follow the light on the posed surface; they do not change if None.
        smooth: Averages the motion of the triangles that carry hair; None if none do.
        hair_shadow: Hair that shades the surface, if colours follow the light; None if none does.
        solids: Moves the triangles that carry teeth or the body as solids; None if none do.
        rig: Rig of the canonical mesh.
    """

    head: HeadModel
    parameters: dict[int, HeadParameters]
    path: GammaPath
    megabytes: int = 512
    shading: Shading | None = None
    smooth: SmoothMotion | None = None
    hair_shadow: HairShadow | None = None
    solids: SolidMotion | None = None
    rig: Rig = field(init=False)

    def __post_init__(self) -> None:
        self.rig = build_rig(self.head.v_template, self.head.faces)
        self._motions: OrderedDict[tuple[int, float], FaceMotion] = OrderedDict()
        self._shades: dict[tuple[int, float], Float32[np.ndarray, "f 3"]] = {}
        self._tracked = dict(self.parameters)
        self._last_caricature: tuple[GammaPath | None, float, Caricature | None] = (None, 0.0, None)
        self._last_pose: tuple[object, object, float, np.ndarray | None] = (None, None, 0.0, None)

    def __setattr__(self, name: str, value: object) -> None:
        """Set an attribute, and drop the motions and shadings that were computed with its last value."""
        super().__setattr__(name, value)
        if name in ("path", "rig", "smooth", "solids"):
            self.__dict__.get("_motions", {}).clear()
        if name in ("path", "rig", "shading", "hair_shadow"):
            self.__dict__.get("_shades", {}).clear()
            self.__dict__.pop("_canonical_transfer", None)

    def set_parameters(self, timestep: int, parameters: HeadParameters) -> None:
        """Replace the parameters of a timestep and drop its cached motions.

        Args:
            timestep: Timestep of the capture.
            parameters: New head parameters, without shape and static offset.
        """
        self.parameters[timestep] = parameters
        for key in [key for key in self._motions if key[0] == timestep]:
            del self._motions[key]

    def add_solids(self, solids: UInt8[np.ndarray, " f"]) -> None:
        """Let triangles move as solids, besides those that do already.

        Args:
            solids: A `Solid` for every triangle; 0 leaves its motion as it is.
        """
        before = 0 if self.solids is None else self.solids.solids
        self.solids = SolidMotion(self.rig, np.where(solids, solids, before).astype(np.uint8))

    def posed(self, timestep: int, level: float) -> Float[np.ndarray, "v 3"]:
        """Posed mesh of a timestep.

        Args:
            timestep: Timestep of the capture.
            level: Exaggeration, 0 for the natural head.

        Returns:
            World vertices in metres.
        """
        return self._pose(self.parameters[timestep], level)

    def _pose(self, parameters: HeadParameters, level: float) -> Float[np.ndarray, "v 3"]:
        """The posed mesh; the last one is kept, because motion and shading of a frame follow each other."""
        path, last, last_level, posed = self._last_pose
        if path is not self.path or last is not parameters or last_level != level:
            posed = pose(self.head, parameters, self._caricature(level) if level else None)
            self._last_pose = (self.path, parameters, level, posed)
        return posed

    def _caricature(self, level: float) -> Caricature:
        """The path at a level; the last one is kept, because to interpolate blendshapes takes longer than to pose."""
        path, last_level, caricature = self._last_caricature
        if path is not self.path or last_level != level:
            caricature = self.path.at(level)
            self._last_caricature = (self.path, level, caricature)
        return caricature

    def shade(self, timestep: int, level: float) -> Float32[np.ndarray, "f 3"] | None:
        """Factor on the colours of every triangle: shading of the posed surface relative to the canonical one.

        Computed on the surface as it was tracked at first: `set_parameters` moves the head by millimetres, which has
        little effect on the shading.

        Args:
            timestep: Timestep of the capture.
            level: Exaggeration, 0 for the natural head.

        Returns:
            Factors on sRGB values, or None if colours do not follow the light.
        """
        if self.shading is None:
            return None
        key = (timestep, float(level))
        if key not in self._shades:
            self._shades[key] = self.shade_of(self._pose(self._tracked[timestep], level))
        return self._shades[key]

    def shade_of(self, posed: Float[np.ndarray, "v 3"]) -> Float32[np.ndarray, "f 3"] | None:
        """Factor on the colours of every triangle of any posed mesh.

        Args:
            posed: World vertices in metres.

        Returns:
            Factors on sRGB values, or None if colours do not follow the light.
        """
        if self.shading is None:
            return None
        after = self.shading.transfer(posed, self.rig.faces, self.hair_shadow)
        return self.shading.face_factors(self._canonical_transfer, after, self.rig.faces)

    @cached_property
    def _canonical_transfer(self) -> Transfer:
        """Transfer of the light that the colours of the surfels were seen in."""
        lit = self.shading.transfer(self.rig.vertices, self.rig.faces)
        if self.hair_shadow is None:
            return lit
        shaded = self.shading.transfer(self.rig.vertices, self.rig.faces, self.hair_shadow)
        return np.where(self.hair_shadow.lit[:, None], lit, shaded)

    def motion(self, timestep: int, level: float) -> FaceMotion:
        """Motion of every triangle from the canonical to the posed mesh.

        Args:
            timestep: Timestep of the capture.
            level: Exaggeration, 0 for the natural head.

        Returns:
            The motion, from the cache if it is there.
        """
        key = (timestep, float(level))
        if key not in self._motions:
            motion = self._motions[key] = self.motion_of(self.posed(timestep, level))
            while len(self._motions) > max(self.megabytes * 2**20 // max(motion.records.nbytes, 1), 1):
                self._motions.popitem(last=False)
        self._motions.move_to_end(key)
        return self._motions[key]

    def motion_of(self, posed: Float[np.ndarray, "v 3"]) -> FaceMotion:
        """Motion of every triangle from the canonical to any posed mesh.

        Args:
            posed: World vertices in metres.

        Returns:
            The motion.
        """
        return face_motion(self.rig, posed, self.smooth and self.smooth.apply, self.solids and self.solids.apply)


def head_sequence(capture: Capture, path: GammaPath) -> HeadSequence:
    """Head sequence of a capture.

    Args:
        capture: Captured subject.
        path: Caricatures of the subject's neutral head.

    Returns:
        The sequence over all timesteps of the capture.

    Raises:
        InputError: If identity or static offset differ between timesteps (there would be no single canonical mesh), or
            if the path has other faces than the head model.
    """
    model = capture.model
    timesteps = sorted({frame.timestep for frame in capture.frames})
    parameters = {t: capture.parameters(t) for t in timesteps}
    if not np.array_equal(path.faces, model.faces):
        raise InputError(
            "its faces are not the head model's: was it made for another subject?", file=capture.head_model
        )
    files = {frame.timestep: frame.parameters for frame in capture.frames}
    offset = parameters[timesteps[0]].static_offset
    for t in timesteps[1:]:
        other = parameters[t].static_offset
        same = (other is None) == (offset is None) and (offset is None or np.allclose(other, offset, atol=1e-7))
        if not same or not np.allclose(parameters[t].shape, parameters[timesteps[0]].shape, atol=1e-6):
            raise InputError(
                f"shape or static_offset differ from timestep {timesteps[0]}'s; one subject has one neutral head",
                file=capture.root / files[t],
            )
    return subject_sequence(model, parameters, path)


def subject_sequence(model: HeadModel, parameters: Mapping[int, HeadParameters], path: GammaPath) -> HeadSequence:
    """Sequence of a subject whose shape and static offset are the same at all timesteps.

    Args:
        model: The head model.
        parameters: Head parameters by timestep.
        path: Caricatures of the subject's neutral head.

    Returns:
        The sequence, with shape and static offset in the template of its head.
    """
    head, no_shape = subject_model(model, next(iter(parameters.values()))), np.zeros(model.num_identity)
    return HeadSequence(head, {t: replace(p, shape=no_shape, static_offset=None) for t, p in parameters.items()}, path)
