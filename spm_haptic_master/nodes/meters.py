"""The package's meters under the name that the nodes know."""

from spm_haptic_master.meters import LatencyMeter, RateMeter

__all__ = ['LatencyMeter', 'RateMeter']
