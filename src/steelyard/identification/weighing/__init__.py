"""What dead weights tell of force sensors."""
