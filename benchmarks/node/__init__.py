"""``ik_node`` beside a node that does nothing, for ``./run bench node``.

A *null node* publishes for each ``target_pose`` a ``joint_command`` that never changes: ordinary
rclpy, a subscription of messages and a publisher. What it takes is what ROS 2 takes from Python;
compare ``ik_node`` with it on the same executor and in the same run.

What is measured:

- *Round trip*: from just before a target is handed to the client's publisher to the client's
  callback for its command. All nodes are alive, each in a namespace of its own; the client sends
  one target at a time, some in a row or a single one to a node, then to the next node, in a new
  random order every time, so that other load on the machine slows all of them. Every target is a
  new one, drawn from the joint box. The client uses the events executor, sends and takes bytes,
  and waits a moment between two targets, until the node has finished what follows its command.
  The client's share of a round trip is the same in all rows.
- *CPU*: processor time of the node's process by ``/proc``, user and system, all its threads.
- *Streams*: a process of its own publishes targets at a rate, each once and each with an x of its
  own; the client takes the commands. It does not catch up when it was late: a burst would not be
  the rate. *With a command*: the targets whose command arrived. *Age*: from just before the target
  was handed to the publisher to the stamp of its command, which the node takes from the system
  clock just before it publishes. One node at a time gets targets. The null node then writes the
  time and the target's x into its command, to tell which target it belongs to.
- *Memory*: resident set of both nodes, with targets at 1 kHz from the same publisher, after a
  warm-up.
- *Start*: from just before the process is started to the first command at a client that has been
  waiting, and repeats a target every 20 ms. The nodes take turns.

The queues are as long as the table says for both nodes, the quality of service is the same, and
field checks of messages (ROS_PYTHON_CHECK_FIELDS) are off. The client's garbage collection is off
while it measures; that of the nodes is as they have it.
"""
