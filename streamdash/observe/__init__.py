"""A measured profile: read, checked, put to the simulated classes, and reported."""
