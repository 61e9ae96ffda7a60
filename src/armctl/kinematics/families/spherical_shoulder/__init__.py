"""Arms of the build *spherical shoulder + elbow (+ roll)*: recognised, solved, explained."""
