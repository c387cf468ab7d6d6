# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The driver's report of itself while the thread of its samples goes on."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed (extra ros)')
encoder_driver = pytest.importorskip('spm_haptic_master.nodes.encoder_driver')


def test_a_caution_that_ends_while_it_is_read_does_not_end_the_driver():
    cautions = iter(['two answers from joint_3a in one cycle'])

    class Source:
        """Its caution ends once it has been read."""

        @property
        def caution(self):
            return next(cautions, None)

    driver = SimpleNamespace(_source=Source(), _unverified=('joint_1a',))
    assert encoder_driver.EncoderDriver._cautions(driver) == [
        'two answers from joint_3a in one cycle', 'direction not verified: joint_1a']
    assert encoder_driver.EncoderDriver._cautions(driver) == ['direction not verified: joint_1a']
