"""ik_node: targets in, joint commands out."""
