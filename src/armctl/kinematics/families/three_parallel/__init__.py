"""Six joints, three in a row on parallel axes: Universal Robots, myCobot, OpenMANIPULATOR-Y."""
