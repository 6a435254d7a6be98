"""Offsets between the clocks of a recording, from the physics that their streams share.

It imports experiments, smoothing and rotations; forces against motion are in identification.
"""
