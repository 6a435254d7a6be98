"""The robot: its description, its cables and what they do to the platform."""
