"""From statements to numbers: normal equations, the joint fit, segmentation, outliers, the bound.

Imports the model only.
"""
