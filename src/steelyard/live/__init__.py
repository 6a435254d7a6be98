"""The estimate while the robot moves: samples that arrive from elsewhere, and what they tell so
far.
"""
