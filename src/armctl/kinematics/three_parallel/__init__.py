"""Arms of six joints, three of them in a row on parallel axes: Universal Robots, myCobot, OpenMANIPULATOR-Y."""
