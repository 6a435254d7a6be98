"""Bodies that can exist: where their mass may lie, the nearest one to an estimate, its Newton steps.

Imports inertia and the mathematics only; knows nothing of experiments.
"""
