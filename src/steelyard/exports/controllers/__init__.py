"""The body as controllers of robots and machines take it."""
