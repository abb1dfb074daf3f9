# annik on ROS 2 Jazzy: docker build -t annik . && docker run --rm --net=host annik
FROM ros:jazzy
SHELL ["/bin/bash", "-c"]
RUN apt-get update && apt-get install -y --no-install-recommends \
        g++ python3-dev python3-pip python3-venv ros-jazzy-ros2launch ros-jazzy-tf2-ros-py \
    && rm -rf /var/lib/apt/lists/*
COPY . /opt/annik_ros/src/annik_ros
WORKDIR /opt/annik_ros
# Ubuntu's own Python takes nothing from pip: an environment on it, with the ROS 2 beneath.
RUN python3 -m venv --system-site-packages venv \
    && touch venv/COLCON_IGNORE \
    && source /opt/ros/jazzy/setup.bash \
    # Ubuntu's ROS messages are compiled for numpy 1.
    && sed 's/^numpy==.*/numpy==1.26.4/' src/annik_ros/constraints.txt | uniq >constraints.txt \
    && venv/bin/pip install --no-cache-dir -c constraints.txt './src/annik_ros[serve]'
ENV PATH=/opt/annik_ros/venv/bin:$PATH
# The entry point of ros:jazzy sources ROS 2 first.
CMD ["ik_node"]
