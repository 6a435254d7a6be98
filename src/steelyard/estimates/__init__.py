"""Estimates as values: parameters, covariance and verdict, their file, comparison and payload.

Knows no estimator and no experiment: exports and `compare` need nothing else of identification.
Imports inertia, digits and files.
"""
