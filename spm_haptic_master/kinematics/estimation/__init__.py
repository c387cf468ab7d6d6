# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Maximum-likelihood orientations from any three to six joint sensors.

`normal_equations` linearises the legs and the sensors at a state, and `gauss_newton` steps from
there until it has a `SampleEstimate`. Where to start, and which of several solutions it is, is for
`sample_estimates` in the 1 kHz path, `estimates` in a batch, and `solutions` where all are wanted.
`damped_fit` tells readings that no orientation explains from those that determine none.
`sensor_faults` has what an orientation by the other sensors says of one.
"""
