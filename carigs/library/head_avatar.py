"""A trained avatar that scripts pose, exaggerate and render."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.capture import Camera
from carigs.errors import SettingsError
from carigs.exaggeration import Caricature, Exaggerator, GammaPath, RegionPaths
from carigs.head import HeadModel, HeadParameters, pose, subject_exaggerator
from carigs.head.teeth import add_teeth
from carigs.library.driving import captured_motion, driven_parameters
from carigs.library.posed_head import PosedHead
from carigs.library.stretch import StretchCheck
from carigs.motion import Motion
from carigs.settings import Exaggerate
from carigs.system.extras import naming_extras

if TYPE_CHECKING:
    from carigs.splat.avatar import Avatar
    from carigs.splat.formats.world_splats import WorldSplats

DEFAULT_LEVEL = 0.25
"""End of the paths of regions if the avatar has no other level than 0."""
Vector = Sequence[float] | Float[np.ndarray, "3"]


def load(file: str | Path) -> HeadAvatar:
    """Read a trained avatar.

    Args:
        file: The avatar (.npz) that a study trained, or that `carigs convert` wrote.

    Returns:
        The avatar.

    Raises:
        InputError: If the file is missing or malformed.
        PackageMissing: If torch is not installed.

    Example:
        >>> avatar = load("results/toy/toy/gamma=0.25/alternating/seed=0/avatar.npz")  # doctest: +SKIP
        >>> image = avatar.render(carigs.orbit(avatar, 1)[0], level=0.2, regions={"nose": 0.2})  # doctest: +SKIP
    """
    with naming_extras():
        from carigs.splat.avatar import load_avatar

    return HeadAvatar(load_avatar(Path(file)))


class HeadAvatar:
    """An avatar, at any exaggeration, expression and pose.

    Attributes:
        avatar: Surfels, rig, head model, and parameters over time.
    """

    def __init__(self, avatar: Avatar) -> None:
        """Take an avatar.

        Args:
            avatar: The avatar.
        """
        self.avatar = avatar

    @property
    def gamma(self) -> float:
        """Highest level that the avatar was made for."""
        return self.avatar.sequence.path.gamma_f

    @property
    def timesteps(self) -> list[int]:
        """Timesteps of the capture, whose expressions and poses the avatar knows."""
        return sorted(self.avatar.sequence.parameters)

    @property
    def regions(self) -> list[str]:
        """Names of the regions that can be exaggerated on their own."""
        return sorted(name for name, ids in self.avatar.sequence.head.regions.items() if len(ids))

    @property
    def joints(self) -> list[str]:
        """Names of the joints that can be turned."""
        return list(self.avatar.sequence.head.joint_names[1:])

    @property
    def expressions(self) -> list[str]:
        """Names of the expression blendshapes; the number of those that the head model does not name."""
        head = self.avatar.sequence.head
        return [*head.expression_names, *map(str, range(len(head.expression_names), head.num_expressions))]

    def pose(
        self,
        level: float = 0.0,
        *,
        regions: Mapping[str, float] | None = None,
        timestep: int | None = None,
        expression: Mapping[str, float] | Sequence[float] | None = None,
        jaw: Vector | None = None,
        neck: Vector | None = None,
        eyes: Vector | None = None,
    ) -> PosedHead:
        """Pose and exaggerate the head.

        Args:
            level: Exaggeration of the whole head, 0 for the natural one. Levels beyond `gamma` are extrapolated.
            regions: Levels of regions by name, added to that of the whole head. The first use of a region solves for
                its path, which takes about a second.
            timestep: Timestep of the capture that expression, pose and light come from; None for the first.
            expression: Coefficients of the expression blendshapes instead: all, the first ones, or some by name.
            jaw: Rotation vector of the joint `jaw` in radians instead.
            neck: Of the joint `neck`.
            eyes: Of the joints `left_eye` and `right_eye`.

        Returns:
            The posed head, to be rendered from any number of cameras.

        Raises:
            SettingsError: If a level, a name or a number of coefficients is not possible.
        """
        joints = {"jaw": jaw, "neck": neck, "left_eye": eyes, "right_eye": eyes}
        parameters = self._parameters(timestep, expression, {name: v for name, v in joints.items() if v is not None})
        return self._posed(parameters, self._caricature(level, regions or {}))

    def animate(
        self,
        motion: Motion,
        level: float = 0.0,
        *,
        regions: Mapping[str, float] | None = None,
        driver: HeadModel | None = None,
    ) -> Iterator[PosedHead]:
        """Drive the head by a motion.

        Args:
            motion: The motion, such as one of `carigs.motion.read_motion`.
            level: Exaggeration of the whole head.
            regions: Levels of regions by name.
            driver: Head model that the motion belongs to, where its expressions have no names that this head knows.

        Yields:
            The posed head of every frame of the motion.

        Raises:
            SettingsError: If a level or a name is not possible, or the motion cannot be transferred.

        Warns:
            CarigsWarning: Expressions that this head lacks or was not trained near, and stretched triangles.

        Example:
            >>> from carigs.motion import BUILT_IN
            >>> heads = avatar.animate(BUILT_IN["talk"](), 0.2)  # doctest: +SKIP
        """
        caricature = self._caricature(level, regions or {})
        frames = driven_parameters(self.avatar.sequence, motion, driver)
        check = StretchCheck(self.avatar.sequence, caricature)
        for parameters in frames:
            head = self._posed(parameters, caricature)
            check.add(head.vertices)
            yield head
        check.warn()

    def captured_motion(self, fps: float = 30.0) -> Motion:
        """The expressions and poses of the capture as a motion, which other avatars can follow.

        Args:
            fps: Timesteps per second.

        Returns:
            The motion.
        """
        return captured_motion(self.avatar.sequence, fps)

    def _posed(self, parameters: HeadParameters, caricature: Caricature | None) -> PosedHead:
        sequence = self.avatar.sequence
        vertices = pose(sequence.head, parameters, caricature)
        return PosedHead(self.avatar, vertices, sequence.motion_of(vertices), sequence.shade_of(vertices))

    def render(self, camera: Camera, **controls: Any) -> Float32[np.ndarray, "h w 3"]:
        """Render one image. For several cameras, `pose` once.

        Args:
            camera: The view, such as one of `carigs.orbit`.
            **controls: Level, regions, timestep, expression and joints, as of `pose`.

        Returns:
            RGB in [0, 1].
        """
        return self.pose(**controls).render(camera)

    def mesh(self, **controls: Any) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
        """The posed mesh below the surfels.

        Args:
            **controls: As of `pose`.

        Returns:
            World vertices in metres, and vertex indices of the triangles.
        """
        return self.pose(**controls).vertices, self.avatar.sequence.head.faces

    def surfels(self, **controls: Any) -> WorldSplats:
        """The surfels as flat Gaussians in world coordinates.

        Args:
            **controls: As of `pose`.

        Returns:
            Centres, rotations, scales, opacities and colours.
        """
        return self.pose(**controls).surfels()

    def _parameters(self, timestep: int | None, expression: Any, joints: Mapping[str, Vector]) -> HeadParameters:
        known, head = self.avatar.sequence.parameters, self.avatar.sequence.head
        timestep = min(known) if timestep is None else timestep
        if timestep not in known:
            raise SettingsError(f"timestep={timestep}: the avatar has {min(known)} to {max(known)} ({len(known)})")
        parameters = known[timestep]
        if expression is not None:
            parameters = replace(parameters, expression=self._coefficients(expression))
        turned = parameters.joints.copy()
        for name, vector in joints.items():
            if name not in head.joint_names[1:]:
                raise SettingsError(f"{name}: this head has the joints {', '.join(self.joints) or 'none'}")
            if np.shape(vector) != (3,) or not np.isfinite(vector).all():
                raise SettingsError(f"{name}={vector}: expected a rotation vector, three numbers in radians")
            turned[head.joint_names.index(name) - 1] = vector
        return replace(parameters, joints=turned)

    def _coefficients(self, expression: Mapping[str, float] | Sequence[float]) -> Float[np.ndarray, " e"]:
        names = self.expressions
        coefficients = np.zeros(self.avatar.sequence.head.num_expressions)
        if isinstance(expression, Mapping):
            for name, value in expression.items():
                if str(name) not in names:
                    raise SettingsError(f"expression {name}: known are {', '.join(names[:8])} ... ({len(names)})")
                coefficients[names.index(str(name))] = value
        else:
            values = np.asarray(expression, np.float64)
            if values.ndim != 1 or len(values) > len(coefficients):
                raise SettingsError(f"expression: expected up to {len(coefficients)} numbers, found {values.shape}")
            coefficients[: len(values)] = values
        if not np.isfinite(coefficients).all():
            raise SettingsError("expression: expected finite numbers")
        return coefficients

    def _caricature(self, level: float, regions: Mapping[str, float]) -> Caricature | None:
        levels = {"level": level, **regions}
        if not np.isfinite(list(levels.values())).all():
            raise SettingsError(f"levels must be finite numbers, found {levels}")
        whole = self.avatar.sequence.path.at(level) if level else None
        moving = {name: value for name, value in regions.items() if value}
        for name in regions:
            if name not in self.regions:
                raise SettingsError(f"regions: there is no {name}; this head has {', '.join(self.regions)}")
        if not moving:
            return whole
        local = RegionPaths({name: self.region_path(name) for name in moving}).displacement(moving)
        if whole is None:
            return Caricature(np.asarray(local, np.float64))
        return replace(whole, displacement=whole.displacement + local)

    def region_path(self, name: str) -> GammaPath:
        """Path of one region, with the rest of the head held; its displacements add to those of the head.

        Args:
            name: One of `regions`.

        Returns:
            The path to the level `gamma`. The first call for a region solves for it.

        Raises:
            SettingsError: If there is no such region, or it cannot be exaggerated alone.
        """
        if name not in self.regions:
            raise SettingsError(f"regions: there is no {name}; this head has {', '.join(self.regions)}")
        if name not in self._region_paths:
            path = self.avatar.sequence.path
            skin = self._exaggerator.region_paths(self.gamma or DEFAULT_LEVEL, [name]).paths[name]
            self._region_paths[name] = add_teeth(skin, path.neutral, path.faces)
        return self._region_paths[name]

    @cached_property
    def _region_paths(self) -> dict[str, GammaPath]:
        return {}

    @cached_property
    def _exaggerator(self) -> Exaggerator:
        sequence = self.avatar.sequence
        return subject_exaggerator(sequence.head, sequence.head.v_template.astype(np.float64), Exaggerate())
