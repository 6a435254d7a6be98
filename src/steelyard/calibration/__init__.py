"""The robot's own geometry from poses at rest and recordings in motion."""
