# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From encoders as their maker ships them to a bus as configured, between processes."""

import pytest
from spm_haptic_master.benchmark.child_process import wait_until

pytest.importorskip('canopen')

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 120.0
# Rate at which a busy machine meets the deadlines.
RATE = ('-p', 'rate:=25.0')


@pytest.fixture
def run(start, bus_channel):
    """Run a program on this test's bus; return its exit code and stdout."""
    def run(name, *args):
        program = start(name, '-p', 'can.interface:=udp_multicast', '-p',
                        f'can.channel:={bus_channel}', *RATE, *map(str, args))
        if name == 'sim_bus':
            assert wait_until(lambda: 'four encoders' in program.stdout, PATIENCE), program.stderr
            return program
        code = program.wait(PATIENCE)
        assert program.stderr.replace('can_scan: ', '').count('\n') <= 4, program.stderr
        return code, program.stdout
    return run


def test_from_the_makers_defaults_to_a_bus_as_configured(run):
    """A scan finds no answers to SYNC; objects by SDO; a scan finds all as configured."""
    run('sim_bus', '--factory')
    code, out = run('can_scan', '--start', '--seconds', 1)
    assert code == 1
    assert 'joint_3a: 0x184 missing; its node 4 is present: does 0x1800:02 answer SYNC?' in out
    code, out = run('can_setup')
    assert code == 1
    assert out.endswith('4 of 4 encoders not as configured; nothing was written (--write)\n')
    code, out = run('can_setup', '--write')
    assert code == 0, out
    assert out.count('after a reset') == 1
    code, out = run('can_scan', '--start', '--seconds', 2)
    assert code == 0, out
