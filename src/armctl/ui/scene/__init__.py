"""The 3D view: the arm, what it stands on, ghosts, lines."""
