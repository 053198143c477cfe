"""Joints and skin weights: root, neck, jaw, left eye, right eye.  Millimetres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from carigs.toy.shape.falloff import smoothstep
from carigs.toy.shape.field import EYE_X, EYE_Y, EYE_Z, MOUTH_CORNER, lip_line
from carigs.toy.shape.template import Template

ROOT = np.array([0.0, -135.0, -26.0])
NECK = np.array([0.0, -78.0, -20.0])
JAW = np.array([0.0, -2.0, 10.0])
PARENTS = np.array([-1, 0, 1, 1, 1])
_MOUTH_Z = 104.0


def jaw_weight(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """How much of the jaw's turn a point of the skin takes: 1 on chin and lower lip, 0 from the upper lip up."""
    x, y, z = np.abs(points[:, 0]), points[:, 1], points[:, 2]
    # The plane through the jaw joint and the lip line: what lies below it belongs to the jaw.
    line = lip_line.py_func(np.minimum(x, MOUTH_CORNER))
    below = JAW[1] + (line - JAW[1]) * (z - JAW[2]) / (_MOUTH_Z - JAW[2])
    mouth = smoothstep((z - 84.0) / 6.0)
    depth = below + mouth * (line - below) - y
    # Lips part in an ellipse: a step between them in the middle, one smooth passage around the corners.
    apart = np.sqrt(np.clip(1 - (x / MOUTH_CORNER) ** 2, 0, 1)) * smoothstep((z - 60.0) / 30.0)
    weight = smoothstep(depth / 52.0 + 0.5)
    weight = weight + apart * (smoothstep(depth / 0.2 + 0.5) - weight)
    # It fades into the neck under the chin, and in front of the ear.
    angle = np.degrees(np.arctan2(JAW[1] - y, np.maximum(z - JAW[2], 1.0)))
    weight *= (1 - smoothstep((angle - 54.0) / 30.0)) * smoothstep((z + 6.0) / 36.0)
    return weight * head_weight(points)


def head_weight(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """How much of the neck joint's turn a point takes: 1 on the head, 0 at the lower end of the neck."""
    return smoothstep((points[:, 1] + 0.35 * points[:, 2] + 165.0) / 85.0)


def skin_weights(shape: Template) -> Float[np.ndarray, "v 5"]:
    """Linear blend skinning weights; rows add up to 1."""
    p = shape.vertices
    weights = np.zeros((len(p), 5))
    head, jaw = head_weight(p), jaw_weight(p)
    weights[:, 0] = 1 - head
    weights[:, 1] = head - jaw
    weights[:, 2] = jaw
    weights[shape.left_eye] = np.eye(5)[3]
    weights[shape.right_eye] = np.eye(5)[4]
    return weights


def joint_regressor(shape: Template) -> Float[np.ndarray, "5 v"]:
    """Weights, adding up to 1, with which the joints follow from the vertices around them.

    Each row is the smallest change of a plain mean that puts the joint where it belongs on the template.
    """
    p = shape.vertices
    x, y, z = np.abs(p[:, 0]), p[:, 1], p[:, 2]
    skin = shape.skin
    around = [
        skin & (np.abs(y + 135) < 22),
        skin & (np.abs(y + 78) < 16) & (z < 20),
        skin & (x > 50) & (np.abs(y + 2) < 30) & (z > -5) & (z < 45),
        shape.left_eye,
        shape.right_eye,
    ]
    eye = np.array([EYE_X, EYE_Y, EYE_Z])
    joints = [ROOT, NECK, JAW, eye, eye * [-1, 1, 1]]
    regressor = np.zeros((5, len(p)))
    for row, inside, joint in zip(regressor, around, joints, strict=True):
        q = np.concatenate([p[inside], np.ones((np.count_nonzero(inside), 1))], axis=1)
        mean = np.full(len(q), 1 / len(q))
        row[inside] = mean + np.linalg.pinv(q.T) @ (np.append(joint, 1.0) - q.T @ mean)
    return regressor
