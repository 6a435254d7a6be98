"""Poses at rest that tell the geometry of a robot: which there are, what each tells, and which of
them to take.
"""
