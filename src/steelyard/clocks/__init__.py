"""Offsets between the clocks of a recording, from the physics that their streams share."""
