"""Where samples come from: one file each, one table of them all."""
