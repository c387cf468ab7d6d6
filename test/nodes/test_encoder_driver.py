# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the driver reports of a source that the test scripts, and what it refuses."""

from contextlib import contextmanager
from itertools import cycle
from math import nan

from in_process import hosted
import numpy as np
import pytest
from rclpy.task import Future
from recording import LOG
from spm_haptic_master.encoders.source import EncoderSource, JointSample
from spm_haptic_master.exceptions import SettingError, SourceEnded
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.nodes import encoder_driver
from spm_haptic_master.parameters.files import simulated_rig
from spm_haptic_master.parameters.geometry import mechanism_checksum
from spm_haptic_master.ros.diagnostic_status import ERROR, OK, WARN
from spm_haptic_master.ros.overload import START, TOO_BUSY

SOURCES = {
    'sim': {'source': 'sim'},
    'replay': {'source': 'replay', 'replay.path': LOG},
    'can': {'source': 'can', 'can.interface': 'udp_multicast', 'can.channel': '239.74.0.0'},
}
# Parameters of the simulated rig, as they are written.
RIG = {name: str(value).lower() for name, value in simulated_rig().items()}
UNVERIFIED = {**RIG, 'encoders.direction_verified': '[true, true, false, false]'}


class ScriptedSource(EncoderSource):
    """A source that reports what the test says, and ends after the samples that it is given."""

    fault = caution = None
    lost = 0.0
    samples = ()

    def read(self, timeout):
        if not self.samples:
            raise SourceEnded('the test has ended')
        return self.samples.pop(0)

    def statistics(self):
        return {}


@contextmanager
def driving(settings, scripted=None):
    """Yield a hosted driver with settings by name; its source is a scripted one if given."""
    with pytest.MonkeyPatch.context() as patch:
        if scripted is not None:
            patch.setattr(encoder_driver, 'make_source', lambda name, values, drives: scripted)
        with hosted(
            lambda given: encoder_driver.EncoderDriver(given, Future()),
            *(f'{name}:={value}' for name, value in settings.items()),
        ) as host:
            yield host


@pytest.fixture
def source():
    return ScriptedSource()


@pytest.fixture
def driver(source):
    with driving(SOURCES['sim'], source) as driver:
        driver.run(2.0 * START)
        yield driver


def state(driver):
    return driver.entry('encoders').level, driver.entry('encoders').message


def test_a_source_without_sets_is_starting_and_then_a_fault(source):
    source.fault = 'no frames'
    with driving(SOURCES['sim'], source) as driver:
        driver.run(0.3)
        assert state(driver) == (WARN, 'starting: no frames [sim]')
        driver.run(0.3)
        assert state(driver) == (ERROR, 'no frames [sim]')
        source.fault = None
        driver.run(0.1)
        assert state(driver) == (OK, 'publishing [sim]')


@pytest.mark.parametrize('kind', ['fault', 'caution'])
def test_what_appears_while_deadlines_are_missed_is_the_machines(driver, source, kind):
    """A SYNC that came late by 0.3 s: what the encoders did meanwhile is no fault of theirs."""
    symptom = 'joint_1a: heartbeat lost'
    source.lost += 0.3
    driver.run(0.04)
    assert driver.node.state.startswith(TOO_BUSY)
    assert driver.node.state.endswith(' s')
    setattr(source, kind, symptom)
    driver.run(0.5)
    assert driver.node.state.startswith(TOO_BUSY)
    assert symptom not in driver.node.state
    # What stays is one of theirs.
    driver.run(1.0)
    assert symptom in driver.node.state


def test_a_caution_that_ends_while_it_is_read_does_not_end_the_driver(driver, monkeypatch):
    """The thread of the samples goes on meanwhile."""
    cautions = cycle(['two answers from joint_3a in one cycle', None])
    monkeypatch.setattr(ScriptedSource, 'caution', property(lambda _: next(cautions)))
    driver.run(0.1)
    found = {entry.message for array in driver.sent['/diagnostics'] for entry in array.status}
    assert {'publishing [sim]', 'two answers from joint_3a in one cycle [sim]'} <= found


def test_a_recording_waits_for_its_listener_and_says_so(source):
    source.waits_for_listener = True
    with driving(SOURCES['sim'], source) as driver:
        driver.subscribed = lambda topic: False
        driver.run(0.1)
        assert state(driver) == (WARN, 'waiting for a listener [sim]')
        source.samples = [JointSample(driver.time_ns(), (0.1, 0.2, 0.3, 0.4))]
        driver.node._stop.wait = driver.pause
        began = driver.monotonic()
        driver.node._run()
        # One of an earlier recording that has no listener is published all the same.
        assert driver.monotonic() - began >= encoder_driver.LISTENER_TIMEOUT
        assert len(driver.sent['measured_js']) == 1
        driver.run(0.1)
        assert state(driver) == (OK, 'publishing [sim]')


def test_two_publishers_are_named_and_override_a_fault(driver, source):
    source.fault = 'no frames'
    driver.publishers['/measured_js'] = 'encoder_driver', 'other'
    driver.run(0.3)
    level, text = state(driver)
    assert level == ERROR
    assert text.startswith('2 publishers on /measured_js: /encoder_driver, ')
    assert text.endswith('; no frames [sim]')


def test_each_set_is_published_and_some_of_them_for_the_eye(driver, source):
    stamps = [driver.time_ns() + 5_000_000 * number for number in range(100)]
    source.samples = [JointSample(stamp, (0.1, 0.2, 0.3, nan)) for stamp in stamps]
    heard = []
    driver.node.listener = lambda stamp, angles: heard.append(stamp)
    driver.node._run()
    assert heard == stamps
    assert isinstance(driver.node._done.result(), SourceEnded)
    sets = driver.sent['measured_js']
    readings = driver.sent['readings']
    assert len(sets) == 100
    assert all(message.name == list(JOINT_NAMES) for message in sets)
    np.testing.assert_array_equal(sets[-1].position, (0.1, 0.2, 0.3, nan))
    # Every tenth of 200 Hz.
    assert [message.header.stamp for message in readings] == [
        message.header.stamp for message in sets[::10]
    ]
    driver.run(1.1)
    figures = driver.figures('encoders')
    assert figures['joints missing'] == 'joint_3a'
    assert figures['mechanism'] == mechanism_checksum(driver.node.values)


@pytest.mark.parametrize(
    ('kind', 'text'),
    [
        ('sim', 'sim'),
        ('replay', f'replay: {LOG.name}'),
        ('can', 'can: udp_multicast 239.74.0.0'),
    ],
)
def test_the_source_is_on_a_latched_topic_and_on_diagnostics(kind, text):
    """Nobody takes a simulated angle for a measured one; and only such a device can be moved."""
    with driving(SOURCES[kind] | ({} if kind == 'sim' else RIG)) as driver:
        driver.run(0.1)
        assert [message.data for message in driver.sent['source']] == [text]
        entry = driver.entry('encoders')
        assert entry.message.endswith(f' [{text}]')
        assert entry.hardware_id == text
        assert driver.figures('encoders')['source'] == text
        topics = {
            each.topic_name
            for each in (*driver.node.publishers, *driver.node.subscriptions)
            if 'simulation' in each.topic_name or 'ground_truth' in each.topic_name
        }
        assert len(topics) == (5 if kind == 'sim' else 0)


@pytest.mark.parametrize('kind', ['can', 'replay'])
@pytest.mark.parametrize(
    ('calibration', 'words'),
    [
        (
            {},
            [
                "'encoders.zero_count' is not set",
                'run `ros2 run spm_haptic_master calibrate',
                '`--params-file calibration.yaml`',
            ],
        ),
        (
            UNVERIFIED,
            [
                "'encoders.direction_verified' is [True, True, False, False]",
                'the direction of joint_1c, joint_3a is not verified',
                'calibrate',
                'encoders.accept_unverified_directions',
            ],
        ),
    ],
)
def test_one_line_names_the_calibration(kind, calibration, words):
    with pytest.raises(SettingError) as error, driving(SOURCES[kind] | calibration):
        pass
    assert '\n' not in str(error.value)
    assert all(word in str(error.value) for word in words), error.value


def test_accepted_unverified_directions_stay_a_warning_beside_another_caution(source):
    with driving(
        SOURCES['can'] | UNVERIFIED | {'encoders.accept_unverified_directions': 'true'}, source
    ) as driver:
        for caution, before in ((None, ''), ('joint_1a: EMCY 0x5000', 'joint_1a: EMCY 0x5000; ')):
            source.caution = caution
            driver.run(1.1)
            level, text = state(driver)
            assert level == WARN
            assert text.startswith(f'{before}direction not verified: joint_1c, joint_3a [can')
        assert driver.figures('encoders')['directions not verified'] == 'joint_1c, joint_3a'
