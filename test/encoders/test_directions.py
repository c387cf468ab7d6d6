# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Directions that no calibration verified are refused, or accepted by name."""

from encoder_frames import values
import pytest
from spm_haptic_master.encoders.decoder_factory import unverified_joints
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.files import source_defaults
from spm_haptic_master.parameters.nodes import SOURCE_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.simulation.source_factory import source_text

REPLAY = {'replay__path': '/data/session.log'}


@pytest.mark.parametrize(('source', 'given'), [('can', {}), ('replay', REPLAY)])
def test_what_decodes_counts_needs_verified_directions(source, given):
    assert unverified_joints(values(source, **given)) == ()
    some = {**given, 'encoders__direction_verified': (True, False, True, False)}
    with pytest.raises(SettingError, match='direction of joint_1b, joint_3a is not verified'):
        unverified_joints(values(source, **some))
    assert unverified_joints(values(
        source, **some, encoders__accept_unverified_directions=True)) == ('joint_1b', 'joint_3a')


def test_a_simulation_has_nothing_to_verify():
    assert unverified_joints(values('sim')) == ()


@pytest.mark.parametrize('source', ['can', 'replay'])
def test_the_package_has_no_calibration_for_a_rig(source):
    """No zero count, and no verified direction, is anyone's default."""
    defaults = {name: value for name, value in source_defaults(source).items()
                if name != 'source'}
    with pytest.raises(SettingError,
                       match=r"'encoders.zero_count' is not set; .* calibrate --motion -o"):
        complete(SOURCE_SETTINGS[source], {
            name: value for name, value in defaults.items()
            if name in {setting.name for setting in SOURCE_SETTINGS[source]}})
    assert defaults['encoders.direction_verified'] == [False] * 4
    assert defaults['encoders.accept_unverified_directions'] is False


@pytest.mark.parametrize(('source', 'given', 'text'), [
    ('sim', {}, 'sim'), ('replay', REPLAY, 'replay: session.log'), ('can', {}, 'can: can0'),
    ('can', {'can__interface': 'pcan', 'can__channel': 'PCAN_USBBUS1'}, 'can: pcan PCAN_USBBUS1')])
def test_a_source_is_named_with_its_bus_or_file(source, given, text):
    assert source_text(source, values(source, **given)) == text
