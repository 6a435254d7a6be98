"""The search for the best motion: its problem, IPOPT, several starts, and scaling to what is
feasible.

Imports commands, information and limits.
"""
