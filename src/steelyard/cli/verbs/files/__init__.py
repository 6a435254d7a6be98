"""Verbs that make files or bring them into other forms."""
