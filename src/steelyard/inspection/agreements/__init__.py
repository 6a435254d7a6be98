"""What the instruments of a run say of each other: a smooth part of the run, the motion by each
instrument's own equations, the ratio of every difference to what is allowed;
imports instruments and the model of identification, nothing else of the inspection.
"""
