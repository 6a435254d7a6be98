"""Experiments: one robot, the instruments on it, and the runs recorded with them; their file, its
schema, reading and writing, and faults of streams.

It imports logs, the robot and instruments; nothing of how an experiment is used.
"""
