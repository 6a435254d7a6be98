"""What moves against a platform, for tests of what it exerts."""

import numpy as np
from scipy.integrate import solve_ivp


def leaning(own, place, mass, motion, times):
    """What a part of a platform on springs along x and y exerts, in moving axes, by integration."""

    def felt(t, along, rate):
        specific_force, omega, alpha = motion(t)
        at = place + np.r_[along, 0.0]
        centrifugal = np.cross(omega, np.cross(omega, at))
        coriolis = 2 * np.cross(omega, np.r_[rate, 0.0])
        return specific_force + np.cross(alpha, at) + centrifugal + coriolis

    def rates(t, state):
        along, rate = state[:2], state[2:]
        pull = -felt(t, along, rate)[:2]
        return np.r_[rate, pull - own**2 * along - 0.2 * own * rate]

    found = solve_ivp(rates, (0, times[-1]), [0.0] * 4, t_eval=times, rtol=1e-6, atol=1e-9)
    wrenches = []
    for t, state in zip(times, found.y.T, strict=True):
        acceleration = np.r_[rates(t, state)[2:], 0.0]
        force = mass * (felt(t, state[:2], state[2:]) + acceleration)
        wrenches.append(np.r_[force, np.cross(place + np.r_[state[:2], 0.0], force)])
    return np.array(wrenches)
