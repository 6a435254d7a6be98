"""What a recording of a motion would say of the body: noise-free recordings and their fit, the
information matrix with its gradient, and the criterion.

Imports commands.
"""
