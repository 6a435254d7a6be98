"""Estimators, one file each, what they share, and what they return."""
