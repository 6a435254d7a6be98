"""Finds what a cable robot carries."""
