"""What other packages provide."""
