"""Virtual experiments: forward dynamics of the robot and the sensors that watch it."""
