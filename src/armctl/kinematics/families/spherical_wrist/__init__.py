"""Six-joint arms whose last three axes meet in a point, or the first three: recognised, solved, explained."""
