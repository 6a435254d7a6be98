"""Where a fit begins: segments of all runs, the motion as its instruments alone give it, a first
body. Imports the fit, and what residuals show that the model has not.
"""
