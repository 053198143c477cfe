"""Which landmarks count: edges with the face around them, what turns away does not."""

import numpy as np
from small_head import small_head

from carigs.fitting.fitted_parameters import fitted_parameters
from carigs.head import SurfacePoints
from carigs.tracking.cameras import Cameras
from carigs.tracking.visibility import facing_camera


def weights(bent: float, **options) -> tuple[np.ndarray, np.ndarray]:
    """How far points of a head count before a camera in front of it, and the heights of their normals along z."""
    model = small_head(subdivisions=3)
    front = np.flatnonzero(model.v_template[:, 2] > 0.5 * model.v_template[:, 2].max())
    vertices = model.v_template.astype(np.float64)
    edge = front[np.argmax(vertices[front, 2])]
    vertices[edge, 2] -= bent
    model.v_template[:] = vertices
    points = SurfacePoints.at_vertices(np.arange(len(vertices)))
    fitted = fitted_parameters(model, np.arange(len(vertices)))
    cameras = Cameras(np.array([900.0]), np.array([[120.0, 120.0]]), np.array([[np.pi, 0, 0, 0, 0, 1.0]]))
    frames = np.zeros((1, fitted.frame_size))
    return facing_camera(model, points, fitted, frames, cameras, **options)[0, 0], vertices


def test_what_looks_at_the_camera_counts_and_the_back_does_not():
    count, vertices = weights(0.0)
    assert (count[vertices[:, 2] > 0.8 * vertices[:, 2].max()] == 1).all()
    assert (count[vertices[:, 2] < 0.8 * vertices[:, 2].min()] == 0).all()


def test_a_wrinkle_counts_as_the_skin_around_it():
    """A vertex is pushed in: the normals beside it turn away from the camera, and the face around does not."""
    alone, vertices = weights(0.5, neighbourhood=0.0)
    together, _ = weights(0.5, neighbourhood=0.05)
    front = vertices[:, 2] > 0.8 * vertices[:, 2].max()
    assert alone[front].min() < 0.9
    assert (together[front] == 1).all()
