"""What residuals show that the model has not: readings that stand out or have lost the motion,
vibrations between the knots, errors of devices, disturbances that nothing explains. Imports what
`identification/solve/` has left of it: the fit.
"""
