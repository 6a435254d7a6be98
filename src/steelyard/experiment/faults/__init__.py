"""What is wrong with streams themselves, whatever they say of the motion."""
