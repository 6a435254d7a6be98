"""Virtual experiments: what a platform does on its cables, and what sensors would record of it.

Imports experiment, instruments, motion and robot; no estimator.
"""
