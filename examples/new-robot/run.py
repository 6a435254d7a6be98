"""A robot that steelyard has never seen, from its CASPR model: import it, add what the model does
not say, simulate, identify.

The import on the command line, which writes a robot file to edit:

    steelyard import examples/new-robot/caspr/*.xml --cables with_rotating_pulleys --out caroca.yaml

With a folder as argument the virtual experiment is written there, its robot file beside it.
"""

import sys
from dataclasses import replace
from pathlib import Path

import polars as pl

import steelyard
from steelyard.robot.model import CableProperties, Limits

imported = steelyard.import_robot(
    sorted((Path(__file__).parent / "caspr").glob("*.xml")), cable_set="with_rotating_pulleys"
)
print(imported)
platform = imported.robot.platform
print(
    f"  the platform can exist: {platform.is_physical} (principal moments"
    f" {platform.principal_moments} kg m^2)"
)

# What the model does not say and who has the robot knows; assumed here.
robot = replace(
    imported.robot,
    name="caroca",
    cable=CableProperties(diameter=0.004, axial_stiffness=2e5, linear_density=0.06),
    tension_limits=(20.0, 1000.0),
    limits=Limits(
        position=((-0.7, -0.7, 0.7), (0.7, 0.7, 1.7)),
        rpy=((-0.35, -0.35, -0.35), (0.35, 0.35, 0.35)),
        speed=2.0,
        acceleration=2.0,
        angular_speed=1.0,
        angular_acceleration=3.0,
    ),
)

virtual = steelyard.simulate(robot, duration=12.0, seed=0)
if len(sys.argv) > 1:
    virtual.write(sys.argv[1])
    print(f"  {sys.argv[1]}: experiment.yaml, robot.yaml and truth.json")

identification = steelyard.identify(virtual.experiment)
print()
print(identification)

truth = virtual.body.body_parameters
table = identification.estimate.to_polars().select("parameter", "unit", "value", "sigma")
print("\nmaximum likelihood against the truth, SI units")
with pl.Config(tbl_hide_dataframe_shape=True, tbl_rows=10, float_precision=4):
    print(
        table.with_columns(truth=truth, error_in_sigmas=(pl.col("value") - truth) / pl.col("sigma"))
    )
