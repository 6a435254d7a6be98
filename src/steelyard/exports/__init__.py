"""The platform for simulators and controllers: one file per format, each with its own frames, signs
and order.
"""
