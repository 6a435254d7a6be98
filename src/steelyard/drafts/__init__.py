"""A first experiment file from logs: what each column may be, which unit it may have,
which logs belong together.

It imports logs, instruments, experiments and the robot; nothing is estimated.
"""
