"""Offsets between the clocks of a recording, from the physics that their streams share.

It imports experiments, instruments, motion and smoothing; forces against motion are in
identification.
"""
