"""Robot files from the formats of other programs: one module per format, and a table of them.

It imports the robot and readers of files; nothing of experiments.
"""
