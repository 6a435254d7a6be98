"""The procedure of the paper: its method, its steps, and how fits of several runs become one."""

from steelyard.identification.methods.two_step.two_step import TwoStep, estimate_two_step

__all__ = ["TwoStep", "estimate_two_step"]
