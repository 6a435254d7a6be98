"""Recordings with the imperfections of real robots, drawn with seeds: MuJoCo and sensor models of
its own, with what the public benchmark has of both. Nothing of steelyard is in them."""
