"""What the robot can do: constraints at one instant, vibration on elastic cables, poses at rest,
and the check of a whole motion by other means.

Imports commands, and the tensions of noise-free recordings.
"""
