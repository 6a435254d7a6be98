"""The experiment before it is made: which motion tells the body best within what the robot can do,
and how well.
"""
