"""The 3D view: the arm from its DH rows, floor, ghosts, trail."""
