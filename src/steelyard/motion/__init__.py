"""How the platform moves: its state, and trajectories that command it."""
