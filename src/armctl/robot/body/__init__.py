"""The body of an arm: convex pieces that a check keeps apart, from its look or from its meshes."""
