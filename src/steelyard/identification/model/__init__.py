"""What readings say: calibration parameters, segments of the motion, residuals of motion and
forces.

Linearised statements about an experiment, nothing solved. Imports instruments, robot, experiment.
"""
