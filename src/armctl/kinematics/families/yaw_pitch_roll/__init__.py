"""Arms of the build *yaw + parallel pitch joints (+ roll)*: recognised, solved, explained."""
