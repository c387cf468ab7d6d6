# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A driver without a calibration publishes nothing; with unverified directions only at WARN."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from harness import status
import pytest
from recording import LOG
from sensor_msgs.msg import JointState
from spm_haptic_master.benchmark.child_process import parameter_arguments
from spm_haptic_master.parameters.files import simulated_rig

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
SOURCES = {'can': {'source': 'can', 'can.interface': 'udp_multicast'},
           'replay': {'source': 'replay', 'replay.path': LOG}}
UNVERIFIED = {**simulated_rig(), 'encoders.direction_verified': [True, True, False, False]}
CAUTION = 'direction not verified: joint_1c, joint_3a'


@pytest.mark.parametrize('source', SOURCES)
@pytest.mark.parametrize(('calibration', 'words'), [
    ({}, ["'encoders.zero_count' is not set", 'run `ros2 run spm_haptic_master calibrate',
          '`--params-file calibration.yaml`']),
    (UNVERIFIED, ["'encoders.direction_verified' is [True, True, False, False]",
                  'the direction of joint_1c, joint_3a is not verified', 'calibrate',
                  'encoders.accept_unverified_directions']),
], ids=['zeros', 'directions'])
def test_one_line_names_the_calibration(start, bus_channel, source, calibration, words):
    parameters = SOURCES[source] | ({'can.channel': bus_channel} if source == 'can' else {})
    driver = start('encoder_driver', parameters={**parameters, **calibration})
    assert driver.wait(PATIENCE) == 1
    assert driver.stderr.count('\n') == 1
    assert all(word in driver.stderr for word in words), driver.stderr


def test_accepted_unverified_directions_stay_a_warning(start, observer, bus_channel):
    """For as long as the driver runs, and beside another caution."""
    samples = observer.collect(JointState, 'measured_js')
    health = observer.collect(DiagnosticArray, '/diagnostics')
    bus = {'can.interface': 'udp_multicast', 'can.channel': bus_channel, 'rate': 250.0}
    start('encoder_driver', parameters={
        'source': 'can', 'can.sync': 'produce', **bus, **UNVERIFIED,
        'encoders.accept_unverified_directions': True})
    start('sim_bus', *parameter_arguments(bus), '--fault', 'emcy:joint_1a@1.0=0x5000')

    def entry():
        return status(health, 'encoder_driver: encoders')

    assert observer.spin_until(lambda: len(samples) > 50, PATIENCE)
    assert observer.spin_until(
        lambda: (found := entry()) is not None and 'EMCY' in found.message, PATIENCE)

    def reported():
        return [(each.level, each.message) for _, array in health for each in array.status
                if 'not verified' in each.message]

    assert observer.spin_until(lambda: len(reported()) >= 3, PATIENCE)
    assert {level for level, _ in reported()} == {DiagnosticStatus.WARN}
    assert all(CAUTION in message for _, message in reported())
    assert 'joint_1a: EMCY' in reported()[-1][1]
    # Without a fault nothing else was reported since the first set.
    first = next(index for index, (_, array) in enumerate(health)
                 if CAUTION in array.status[0].message)
    assert [array.status[0].message for _, array in health[first:]
            if array.status[0].level == DiagnosticStatus.OK] == []
    assert {value.key: value.value for value in entry().values}['directions not verified'] \
        == 'joint_1c, joint_3a'
