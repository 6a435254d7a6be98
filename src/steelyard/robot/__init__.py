"""The robot: its file, rollers, hanging cables, structure matrix and tension distribution.

Imports dynamics and the mathematics only; knows no motion and no instrument.
"""
