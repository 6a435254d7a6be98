"""What 3-D views are drawn of."""

import numpy as np

from steelyard.report.blocks.robot_scene import hull_edges


def test_edges_of_what_attachments_span():
    cube = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    assert len(hull_edges(cube)) == 12
    assert all(np.isclose(np.linalg.norm(cube[i] - cube[j]), 1.0) for i, j in hull_edges(cube))
    flat = cube[::2]
    assert len(hull_edges(flat)) == 4
    assert all(np.isclose(np.linalg.norm(flat[i] - flat[j]), 1.0) for i, j in hull_edges(flat))
    assert hull_edges(cube[:1]) == [(0, 0)]
