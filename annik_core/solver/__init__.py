"""The solver: pose to joint positions, refined and checked."""
