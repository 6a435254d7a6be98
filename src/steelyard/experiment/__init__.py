"""Experiments: one robot, the instruments on it, and the runs recorded with them."""
