"""One file per estimation method, from an experiment to an `Estimate` with its verdict.

Imports model, solve, verdict, bodies and estimates.
"""
