"""Kinematic experiments: no physics, no bus, one robot description and a method of the stack; run by `canipulator.kinematic_run`."""
