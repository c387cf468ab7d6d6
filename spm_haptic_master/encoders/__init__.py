"""
What is on the encoders' bus, and what a frame passes on its way to a joint sample.

Imports python-can and the top-level modules; no ROS, no mechanism.
"""
