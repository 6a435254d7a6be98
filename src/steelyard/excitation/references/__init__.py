"""What to record beside an experiment so that its body is known better: weighed bodies and further
poses at rest, by the information that they add.
"""
