# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated rig with harmonics, and a driver that corrects them: the joint angles are back."""

from math import degrees

from encoder_frames import values
import numpy as np
import pytest
from spm_haptic_master.nodes.source_factory import make_source
from spm_haptic_master.simulation.rig_file import rig_text
from spm_haptic_master.simulation.settings import make_motion, make_rig

COUNT = 2.0 * np.pi / 16384
RIG = {'sim__rig_seed': 4, 'sim__tolerance_deg': [0.0, 0.0], 'sim__harmonics_deg': [1.0, 0.0],
       'sim__noise_deg': 0.0}


def corrections(rig):
    """Return the parameters that correct the first harmonics of a rig's encoders."""
    cosine, sine = zip(*(each.first_harmonic for each in rig.sensors), strict=True)
    return {'encoders__harmonic_cos_deg': list(map(degrees, cosine)),
            'encoders__harmonic_sin_deg': list(map(degrees, sine))}


def test_the_simulated_source_corrects_what_the_file_says():
    plain = values('sim', **RIG)
    corrected = values('sim', **RIG, **corrections(make_rig(plain)))
    for t in (0.0, 2.0, 5.0):
        true = make_motion(plain).joints(t)
        raw, angles = make_source('sim', plain).angles(t), make_source('sim', corrected).angles(t)
        assert np.abs(np.subtract(raw, true)).max() > 10.0 * COUNT
        np.testing.assert_allclose(angles, true, atol=0.6 * COUNT)


def test_a_simulated_bus_has_the_harmonics_of_its_rig_once(tmp_path, monkeypatch):
    """Also where it reads the same file as the driver that corrects them."""
    from spm_haptic_master.tools import sim_bus
    rig = make_rig(values('sim', **RIG))
    path = tmp_path / 'rig.json'
    path.write_text(rig_text(rig))
    seen = []

    def stop(layouts, *rest):
        seen.extend(layouts)
        raise KeyboardInterrupt

    monkeypatch.setattr(sim_bus, 'SimulatedBus', stop)
    arguments = ['sim_bus', '-p', 'can.interface:=virtual', '-p', 'can.channel:=harmonics']
    for name, value in corrections(rig).items():
        arguments += ['-p', f'{name.replace("__", ".")}:={value}']
    with pytest.raises((SystemExit, KeyboardInterrupt)):
        raise SystemExit(sim_bus.main([*arguments, '-p', f'sim.rig_file:={path}']))
    assert [layout.harmonics for layout in seen] == [None] * 4
    seen.clear()
    with pytest.raises((SystemExit, KeyboardInterrupt)):
        raise SystemExit(sim_bus.main(arguments))
    assert all(layout.harmonics is not None for layout in seen)
