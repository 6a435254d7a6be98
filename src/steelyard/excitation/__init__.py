"""The experiment before it is made: the most informative motion within the limits of the robot, and
the precision that it will give.

Imports the estimators, whose own information it predicts; nothing of inspection or report.
"""
