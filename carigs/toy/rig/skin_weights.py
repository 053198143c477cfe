"""Joints and linear blend skinning weights: root, neck, jaw, left eye, right eye. Lengths are in millimetres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from carigs.head.joint_regression import regressor_row
from carigs.mesh.smoothstep import smoothstep
from carigs.toy.shape.anatomy import EYE_CENTRE, MOUTH_CORNER, lip_height
from carigs.toy.shape.template import Template

JAW = np.array([0.0, -2.0, 10.0])
"""Position of the jaw joint."""
_ROOT, _NECK = np.array([0.0, -135.0, -26.0]), np.array([0.0, -78.0, -20.0])
PARENTS = np.array([-1, 0, 1, 1, 1])
_MOUTH_Z = 104.0


def jaw_weight(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Skinning weight of the jaw joint on the head surface.

    Args:
        points: Positions on the template, in millimetres.

    Returns:
        Weights: 1 on chin and lower lip, 0 from the upper lip upwards.
    """
    x, y, z = np.abs(points[:, 0]), points[:, 1], points[:, 2]
    # Points below the plane through the jaw joint and the lip line belong to the jaw.
    line = lip_height(np.minimum(x, MOUTH_CORNER))
    below = JAW[1] + (line - JAW[1]) * (z - JAW[2]) / (_MOUTH_Z - JAW[2])
    mouth = smoothstep((z - 84.0) / 6.0)
    depth = below + mouth * (line - below) - y
    # A step between the lips at the midline, a smooth transition around the corners of the mouth.
    separation = np.sqrt(np.clip(1 - (x / MOUTH_CORNER) ** 2, 0, 1)) * smoothstep((z - 60.0) / 30.0)
    weight = smoothstep(depth / 52.0 + 0.5)
    weight = weight + separation * (smoothstep(depth / 0.2 + 0.5) - weight)
    # Fade into the neck under the chin, and in front of the ear.
    angle = np.degrees(np.arctan2(JAW[1] - y, np.maximum(z - JAW[2], 1.0)))
    weight *= (1 - smoothstep((angle - 54.0) / 30.0)) * smoothstep((z + 6.0) / 36.0)
    return weight * _head_weight(points)


def _head_weight(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Skinning weight of the neck joint and its children: 1 on the head, 0 at the lower end of the neck."""
    return smoothstep((points[:, 1] + 0.35 * points[:, 2] + 165.0) / 85.0)


def skin_weights(template: Template) -> Float[np.ndarray, "v 5"]:
    """Linear blend skinning weights of the template.

    Args:
        template: The template mesh, in millimetres.

    Returns:
        Weights of the five joints; rows sum to 1.
    """
    p = template.vertices
    head, jaw = _head_weight(p), jaw_weight(p)
    weights = np.stack([1 - head, head - jaw, jaw, 0 * head, 0 * head], axis=1)
    weights[template.left_eye] = np.eye(5)[3]
    weights[template.right_eye] = np.eye(5)[4]
    return weights


def joint_regressor(template: Template) -> Float[np.ndarray, "5 v"]:
    """Joint regressor: positions of the joints as weighted sums of the vertices around them.

    Args:
        template: The template mesh, in millimetres.

    Returns:
        Weights; rows sum to 1.
    """
    p = template.vertices
    x, y, z = np.abs(p[:, 0]), p[:, 1], p[:, 2]
    on_head = template.on_head
    joints = [
        (_ROOT, on_head & (np.abs(y + 135) < 22)),
        (_NECK, on_head & (np.abs(y + 78) < 16) & (z < 20)),
        (JAW, on_head & (x > 50) & (np.abs(y + 2) < 30) & (z > -5) & (z < 45)),
        (EYE_CENTRE, template.left_eye),
        (EYE_CENTRE * [-1, 1, 1], template.right_eye),
    ]
    return np.stack([regressor_row(p, inside, joint) for joint, inside in joints])
