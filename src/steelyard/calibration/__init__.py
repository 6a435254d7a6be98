"""The robot's own geometry from poses at rest."""
