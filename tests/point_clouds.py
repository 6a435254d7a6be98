"""Bodies made of point masses, by the definitions of their numbers."""

import numpy as np


class Cloud:
    """A cloud of point masses: sums over its points."""

    def __init__(self, masses, points):
        self.mass = masses.sum()
        self.cog = masses @ points / self.mass
        self.first_moment = masses @ points
        self.about_cog = self.moments(masses, points - self.cog)
        self.about_origin = self.moments(masses, points)

    @staticmethod
    def moments(masses, points):
        x, y, z = points.T
        xx, yy, zz = masses @ (y * y + z * z), masses @ (x * x + z * z), masses @ (x * x + y * y)
        yz, xz, xy = -masses @ (y * z), -masses @ (x * z), -masses @ (x * y)
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @property
    def ten(self):
        J = self.about_cog
        return np.array(
            [self.mass, *self.cog, J[0, 0], J[1, 1], J[2, 2], J[1, 2], J[0, 2], J[0, 1]]
        )

    @property
    def signs(self):
        return tuple(np.sign(self.ten[7:]).astype(int).tolist())


def clouds():
    """A body for each combination of signs of the three products, from a gram and a centimetre to a
    tonne and metres."""
    rng = np.random.default_rng(7)
    found = {}
    while len(found) < 8:
        size = 10 ** rng.uniform(-2, 0.5)
        cloud = Cloud(
            10 ** rng.uniform(-4, 2) * rng.uniform(0.1, 1, 12), size * rng.normal(size=(12, 3))
        )
        found.setdefault(cloud.signs, cloud)
    return [found[signs] for signs in sorted(found)]


CLOUDS = clouds()
CLOUD = CLOUDS[2]
