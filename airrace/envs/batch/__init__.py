"""Many drones at once, in machine code: what gymnasium.make_vec("airrace/Race-v0") steps."""
