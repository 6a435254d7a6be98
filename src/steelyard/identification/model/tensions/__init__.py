"""Tensions of the cables as all that is fitted has them, for readings that follow these."""
