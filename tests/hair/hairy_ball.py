"""A ball with smooth skin, seen by a ring of cameras, with strands that stand off a cap of it."""

import numpy as np
from surfaces import sphere

from carigs.capture import Camera, look_at
from carigs.hair.views import HairView
from carigs.raster import compute_visibility

RADIUS, STANDOFF, CAP = 0.1, 0.012, 0.3
"""Metres; metres between skin and strands; height of the cap's rim over the centre, in radii."""
SIZE = 160


def ball():
    """Vertices and faces."""
    vertices, faces = sphere(4, RADIUS)
    return vertices, faces


def cameras(count=18):
    """Cameras around the ball, above and below its equator, with pixels of about 1.4 mm."""
    for i in range(count):
        azimuth, height = 2.4 * i, (0.15, 0.5, -0.1)[i % 3]
        centre = 0.9 * np.array([np.sin(azimuth), height, np.cos(azimuth)])
        yield Camera(look_at(centre, np.zeros(3)), 650.0, 650.0, SIZE / 2, SIZE / 2, SIZE, SIZE)


def first_hit(camera, radius):
    """Point and validity of the first intersection of each pixel's ray with a sphere around the origin."""
    column, row = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([(column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, np.ones_like(row)], axis=-1)
    rays = rays @ camera.camera_from_world[:3, :3]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    along = rays @ camera.centre
    root = along**2 - camera.centre @ camera.centre + radius**2
    distance = -along - np.sqrt(np.maximum(root, 0))
    return camera.centre + distance[..., None] * rays, root > 0


def skin_colour(point):
    """Smooth colours."""
    shade = 0.6 + 0.15 * np.sin(12 * point[..., 0] + 3) * np.cos(9 * point[..., 1])
    return np.stack([shade, 0.8 * shade, 0.65 * shade], axis=-1)


def freckles(point):
    """Dark dots painted on the skin."""
    cells = np.sin(700 * point[..., 0]) * np.sin(700 * point[..., 1]) * np.sin(700 * point[..., 2])
    return (cells > 0.4)[..., None]


def strands(point):
    """Where a strand passes: half of the directions around the vertical axis, 1.5 mm wide."""
    azimuth = np.arctan2(point[..., 0], point[..., 2])
    return np.sin(azimuth * 2 * np.pi * RADIUS / 0.003) > 0


def views(hair=True, dots=False, noise=0.0, count=18, brightness=1.0, scale=1.0):
    """Images, mattes and the visibility of the ball without its hair."""
    vertices, faces = ball()
    rng = np.random.default_rng(0)
    for camera in cameras(count):
        camera = camera.scaled(scale)
        point, on_ball = first_hit(camera, RADIUS)
        colour = skin_colour(point)
        if dots:
            colour = np.where(freckles(point), 0.75 * colour, colour)
        image = np.where(on_ball[..., None], brightness * colour, 1.0)
        matte = on_ball.astype(float)
        if hair:
            outer, on_shell = first_hit(camera, RADIUS + STANDOFF)
            strand = on_shell & (outer[..., 1] > CAP * RADIUS) & strands(outer)
            image = np.where(strand[..., None], 0.1, image)
            matte = np.maximum(matte, strand)
        image = (image + noise * rng.standard_normal(image.shape)).clip(0, 1)
        seen = compute_visibility(vertices, faces, camera)
        yield HairView(image.astype(np.float32), matte.astype(np.float32), seen, np.zeros(matte.shape, bool))
