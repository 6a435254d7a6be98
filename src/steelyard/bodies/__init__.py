"""Bodies that can exist: where their mass may lie, the nearest one to an estimate, and its
two solvers.

Imports inertia and the mathematics only; knows nothing of experiments.
"""
