"""Monte Carlo: the same experiment recorded again and again, in simulation or by drawing from its
own recordings.
"""
