"""The solver families: a folder each, and the registry that finds the one of an arm."""
