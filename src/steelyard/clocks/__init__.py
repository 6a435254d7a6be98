"""How far the clocks of a recording are apart, from the physics that their streams share."""
