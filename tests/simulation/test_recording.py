"""What winches read on ropes that damp, against an equation of motion of SciPy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from steelyard.instruments import Length
from steelyard.motion.trajectory import RestToRest
from steelyard.robot.file import read_robot
from steelyard.simulation.recording import draw_errors, record
from steelyard.simulation.response import ExactMotion

LAG = 0.03  # [s]
SPEED = 2 * np.pi * 0.5  # of the tensions [1/s]
CLOSE = 1e-2  # of what damping takes, relative: the speed at which cables are fed is that of now, not of a lag ago


@pytest.mark.integration
@pytest.mark.parametrize("fed", [0.0, LAG], ids=["damped in itself", "a damper that spans it"])
def test_a_winch_reads_what_a_spring_beside_a_damper_leaves(fed):
    robot = read_robot("cogiro").with_straight_cables()
    robot = replace(
        robot,
        cable=replace(robot.cable, axial_stiffness=2e4),
        pulley_radius=np.zeros(robot.m),
    )
    exact = {
        "offset": 0,
        "damping": {"value": (LAG, fed), "sigma": 0},
    }
    winches = Length.model_validate({"kind": "length", "rate": 50.0, "calibration": exact})
    motion = ExactMotion(
        robot, robot.platform, RestToRest([-1, 0, 1.5, 0, 0, 0], [1, 0.5, 2.5, 0, 0, 0], 4.0)
    )

    def pull(times):
        return 1000 + 300 * np.sin(np.multiply.outer(times, np.full(robot.m, SPEED)))

    class Pulling:
        duration = motion.duration

        def at(self, times):
            return replace(motion.at(times), tension=pull(times))

    rng = np.random.default_rng(0)
    errors = draw_errors({"winches": winches}, robot.m, ["run"], rng)["run"]
    streams, sync = record(Pulling(), {"winches": winches}, errors, robot, motion, rng)
    time = streams["winches"].time - sync["winches"]

    def reach(times):
        at = motion.at(times)
        points = at.position[:, None] + np.einsum("nij,mj->nmi", at.rotation, robot.attachments)
        return np.linalg.norm(robot.anchors - points, axis=2)

    def slope(t, strain):
        # Strain, or the whole stretch, which is strain times length, obeys the same equation.
        at = np.array([t])
        before, after = reach(at - 1e-5)[0], reach(at + 1e-5)[0]
        spread = fed / LAG * (after - before) / 1e-5 / (after + before)
        return (pull(at)[0] / 2e4 - strain) / LAG - spread * strain

    strain = solve_ivp(
        slope,
        (0.1, 3.9),
        pull(np.array([0.1]))[0] / 2e4,
        t_eval=time[(time > 0.5) & (time < 3.8)],
        rtol=1e-8,
        atol=1e-10,
    )
    later = np.isin(time, strain.t)
    damped, whole = (reach(strain.t) / (1 + s) for s in (strain.y.T, pull(strain.t) / 2e4))
    found = streams["winches"].values["length"][later]
    taken = np.abs(damped - whole).max()
    assert taken > 5e-3
    assert np.abs(found - damped).max() < CLOSE * taken
