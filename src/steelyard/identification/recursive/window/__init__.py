"""The motion of one run as far as it is still fitted, chunk by chunk, and what remains of all
before.
"""
