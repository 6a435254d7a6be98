"""The body as it is drawn."""

import numpy as np

from steelyard.inertia import Inertia
from steelyard.report.documents.sections.platform import box_of


def test_the_box_has_the_inertia_of_the_body():
    """By summing up a fine grid of points within it."""
    body = Inertia(
        12.0,
        np.array([0.1, -0.2, 0.3]),
        np.array([[2.0, 0.3, -0.2], [0.3, 1.8, 0.4], [-0.2, 0.4, 1.1]]),
    )
    half, axes = box_of(body)
    line = (np.arange(60) + 0.5) / 30 - 1
    points = (np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3) * half) @ axes.T
    second = points.T @ points * body.mass / len(points)
    np.testing.assert_allclose(
        np.trace(second) * np.eye(3) - second, body.inertia, rtol=1e-3, atol=1e-3
    )
