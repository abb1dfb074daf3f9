"""bag_recorder: records annik's topics to a bag."""
