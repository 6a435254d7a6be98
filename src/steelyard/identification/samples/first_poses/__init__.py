"""Poses to begin with where no instrument tells one by itself."""
