"""Orientation of a spherical parallel haptic master from four joint sensors."""

__version__ = '0.1.0'
