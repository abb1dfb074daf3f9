"""The ROS 2 nodes of annik: thin shells around annik_core."""
