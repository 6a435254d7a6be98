"""The same recording as somebody else would have described it: with another world frame and another
platform frame."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

Z_DOWN = Rotation.from_euler("x", 180, degrees=True)
ANY_WAY = Rotation.from_rotvec([0.9, -1.7, 0.6])
BACK = ANY_WAY.inv()
FAR = np.array([1.9, -0.8, 2.7])


def in_other_frames(experiment, world=ANY_WAY, platform=BACK, at=FAR):
    """An experiment whose instruments stand in the world and on the platform, retold.

    Args:
        experiment: With instruments that have no frame of their own.
        world: From the present world frame to the other one.
        platform: From the present platform frame to the other one.
        at: Where the origin of the present platform frame is in the other one [m].
    """
    robot = experiment.robot
    return replace(
        experiment,
        robot=replace(
            robot,
            anchors=robot.anchors @ world.as_matrix().T,
            pulley_axis=robot.pulley_axis @ world.as_matrix().T,
            gravity=world.as_matrix() @ robot.gravity,
            attachments=robot.attachments @ platform.as_matrix().T + at,
            platform=None,
        ),
        instruments={
            name: _instrument(each, platform, at) for name, each in experiment.instruments.items()
        },
        runs=tuple(
            replace(
                run,
                streams={
                    name: _commanded(_read(each, world), platform, at)
                    if experiment.instruments[name].commanded
                    else _read(each, world)
                    for name, each in run.streams.items()
                },
            )
            for run in experiment.runs
        ),
    )


def _instrument(instrument, platform, at):
    mounting, changes = instrument.mounting, {}
    if mounting.point is not None:
        changes[mounting.point_key] = tuple(platform.apply(mounting.point) + at)
    if mounting.rpy_deg is not None:
        turned = platform * Rotation.from_matrix(mounting.rotation)
        changes["rpy_deg"] = tuple(turned.as_euler("ZYX", degrees=True)[::-1])
    return instrument.model_copy(update=changes)


def _read(stream, world):
    values = dict(stream.values)
    if "position" in values:
        values["position"] = values["position"] @ world.as_matrix().T
    if "orientation" in values:
        values["orientation"] = world.as_matrix() @ values["orientation"]
    return replace(stream, values=values)


def _commanded(stream, platform, at):
    """Of the platform frame itself."""
    R = stream.values["orientation"] @ platform.inv().as_matrix()
    position = stream.values["position"] - R @ at
    return replace(stream, values={**stream.values, "position": position, "orientation": R})


def body_in_other_frame(value, platform=BACK, at=FAR):
    """The ten of BODY_PARAMETERS in the other platform frame, shape (10,)."""
    mass, cog, (xx, yy, zz, yz, xz, xy) = value[0], value[1:4], value[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    R = platform.as_matrix()
    J = R @ inertia @ R.T
    products = J[1, 2], J[0, 2], J[0, 1]
    return np.array([mass, *(R @ cog + at), *np.diag(J), *products])
