# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The mechanism as built in real nodes: the same in driver and fkm, or silence."""


from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import QuaternionStamped
from harness import SIM, status
import pytest
from rig_as_built import mechanism

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
POSE_DEG = [130.0, 50.0, 20.0]
DRIVER = {**SIM, 'sim.trajectory': 'fixed', 'sim.pose_deg': POSE_DEG, 'rate': 200.0}
ENTRIES = ('encoder_driver: encoders', 'fkm: orientation', 'diagnostics: singularity')


def checksum(health, name):
    """Return a node's checksum on /diagnostics, None if there is none yet."""
    entry = status(health, name)
    return {value.key: value.value for value in entry.values}.get('mechanism') if entry else None


def test_fkm_is_silent_with_a_driver_of_another_mechanism(start, observer):
    orientations = observer.collect(QuaternionStamped, 'left/orientation')
    health = observer.collect(DiagnosticArray, '/diagnostics')
    space = ('-r', '__ns:=/left')
    fkm = start('fkm', *space, parameters={**mechanism(), 'rate': 200.0})
    # A driver elsewhere, which is none of its own.
    other = start('encoder_driver', '-r', '__ns:=/right', parameters=DRIVER)
    assert observer.spin_until(
        lambda: checksum(health, 'right/encoder_driver: encoders')
        and status(health, 'left/fkm: orientation'), PATIENCE)
    observer.spin(1.2)
    assert status(health, 'left/fkm: orientation').message == 'starting'
    moving = {**DRIVER, 'sim.trajectory': 'sweep'}
    driver = start('encoder_driver', *space, parameters=moving)

    def entry():
        return status(health, 'left/fkm: orientation')

    assert observer.spin_until(
        lambda: entry().message == 'silent: another mechanism in the driver'
        and checksum(health, 'left/encoder_driver: encoders'), PATIENCE)
    assert entry().level == DiagnosticStatus.ERROR
    assert checksum(health, 'left/fkm: orientation') \
        != checksum(health, 'left/encoder_driver: encoders') \
        == checksum(health, 'right/encoder_driver: encoders')
    observer.spin(0.2)
    orientations.clear()
    observer.spin(1.5)
    assert orientations == []
    values = {value.key: value.value for value in entry().values}
    assert 'left/encoder_driver has' in values['last rejected']
    assert 'for all nodes, /**' in values['last rejected']
    assert driver.stop() == 0
    # The right one in its place: the silence ends.
    start('encoder_driver', *space, parameters={**moving, **mechanism()})
    assert observer.spin_until(
        lambda: entry().message.startswith('healthy') and len(orientations) > 20, PATIENCE), \
        entry()
    assert other.stop() == 0
    assert fkm.stop() == 0
