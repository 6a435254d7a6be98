"""Motions of the platform: its state, commanded trajectories, and the limits that they must keep.

Imports robot and the mathematics; knows no instrument.
"""
