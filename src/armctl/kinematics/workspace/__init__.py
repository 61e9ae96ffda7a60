"""What an arm reaches: a cloud of tool points, and its section in the vertical plane."""
