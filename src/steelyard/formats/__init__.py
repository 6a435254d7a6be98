"""The files that are written: their format numbers and their schemas."""
