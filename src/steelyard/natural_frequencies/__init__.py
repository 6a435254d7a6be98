"""Equilibrium and natural frequencies of a body that hangs on cables of constant length."""
