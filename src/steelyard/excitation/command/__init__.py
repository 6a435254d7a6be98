"""Commands: the motion splines to choose from, and the state of the platform at one instant.

Imports the models of robot, motion and force balance.
"""
