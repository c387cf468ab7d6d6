"""
Command lines of the programs beside the nodes: arguments in, one call, text and exit code out.

Imports every room but nodes; no ROS.
"""
