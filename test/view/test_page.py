# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figures, plots and the encoders' states: of what is known now, and a dash for all else."""

import json
from math import isnan, nan, radians

from contrast import contrast, DARK_PAGE, WHITE_PAGE
from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from shown_device import entries_of
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.view.content import content
from spm_haptic_master.view.legend import legend
from spm_haptic_master.view.page import NEWS, Page, RunJavascriptMessage, script
from spm_haptic_master.view.seen import Seen, Settings
from spm_haptic_master.view.sentence import DASH
from spm_haptic_master.view.status import Banner, Light, SensorState
from spm_haptic_master.view.stories import stories, StoryNews
from std_msgs.msg import Float64MultiArray

# Entries by name: level, message and values.
CLEAR = {
    'diagnostics: singularity': (
        DiagnosticStatus.OK,
        'clear',
        {'warn below': '0.059', 'error below': '0.033'},
    )
}
HEALTHY = SensorState.HEALTHY
UNCHECKED = SensorState.UNCHECKED
MISSING = SensorState.MISSING
EXCLUDED = SensorState.EXCLUDED


def figures(
    entries=None,
    now=1.0,
    sensors=4,
    **known,
):
    """Return what the page has of a device that is alive at the centre."""
    seen = {
        'banner': Banner(
            light=Light.GREEN,
            text='healthy',
            alive=True,
            event='healthy',
        ),
        'settings': Settings(
            sensors=sensors,
            alert_limit=2.0,
            calibration='calibrated 2026-11-26',
        ),
        'angles': [0.1] * 9,
        'states': [HEALTHY] * sensors,
        'orientation': (0.0, 0.0, 0.0, 1.0),
        'dexterities': (0.15, 0.4),
    }
    return content(Seen(**seen | known), entries_of(entries or {}, now))


def rows_of(found):
    """Return the texts of the figures by their names."""
    return {row['name']: row['text'] for row in found['rows']}


# A device whose picture is of the past.
SILENT = {
    'banner': Banner(
        light=Light.RED,
        text='silent: x',
        alive=False,
        event='silent: x',
    )
}
STORY = StoryNews(
    name='a story',
    view='front',
    words='Watch.',
    step=1,
    steps=3,
    number=7,
)


@pytest.mark.parametrize(
    ('known', 'words', 'warns'),
    [
        ({}, 'Three encoders determine this pose. With four they check', False),
        ({'dexterities': (0.01, 0.059)}, 'do not determine this pose; four encoders do.', True),
        ({'dexterities': (0.001, 0.002)}, 'Not even four encoders', True),
        ({'dexterities': (0.059, 0.4)}, 'Three encoders determine this pose', False),
        ({'dexterities': None}, DASH, False),
        ({'ghost': radians(3.1)}, 'Three encoders alone are 3\u00b0 wrong', True),
        ({'ghost': radians(2.9)}, 'Three encoders determine', False),
        (SILENT, 'not the present pose', True),
        # Limits are those of the node diagnostics, while it runs.
        ({'now': 10.0}, DASH, False),
        ({'story': STORY} | SILENT, 'Watch.', False),
    ],
)
def test_a_sentence_says_which_encoders_determine_the_pose(
    known,
    words,
    warns,
):
    note = figures(CLEAR, **known)['note']
    assert words in note['text']
    assert note['warns'] == warns


@pytest.mark.parametrize(
    ('states', 'words'),
    [
        ([HEALTHY] * 4, 'With four they check one another.'),
        ([*[HEALTHY] * 3, UNCHECKED], 'th3A is not checked by the others here.'),
        (
            [UNCHECKED, UNCHECKED, HEALTHY, HEALTHY],
            'th1A, th1B are not checked by the others here.',
        ),
        ([MISSING, EXCLUDED, *[HEALTHY] * 4], 'With four they check one another.'),
        ([MISSING, HEALTHY, HEALTHY, HEALTHY], 'Three encoders determine this pose.'),
        ([SensorState.UNKNOWN] * 4, 'Three encoders determine this pose.'),
    ],
)
def test_what_the_sentence_says_of_checks_is_what_the_chips_show(states, words):
    """Never that they check one another beside a chip that says they do not."""
    text = figures(CLEAR, sensors=len(states), states=states)['note']['text']
    assert text.endswith(words)
    assert ('check one another' in text) == (
        UNCHECKED not in states and words.startswith('With four')
    )


@pytest.mark.parametrize(
    ('dexterities', 'lights'),
    [
        ((0.01, 0.05), (Light.RED, Light.AMBER)),
        ((0.033, 0.059), (Light.AMBER, Light.GREEN)),
        ((nan, 0.4), (Light.GREY, Light.GREEN)),
        (None, (Light.GREY, Light.GREY)),
    ],
)
def test_the_bars_of_the_dexterity(dexterities, lights):
    """Full at 0.2; grey where the value or its limits are not known; with a sign."""
    for entries, expected in ((CLEAR, lights), ({}, (Light.GREY, Light.GREY))):
        rows = figures(entries, dexterities=dexterities)['rows']
        bars = [row for row in rows if row['share'] is not None]
        for value, bar, light in zip(dexterities or (nan, nan), bars, expected, strict=True):
            assert bar['colour'] == light.colour
            if isnan(value):
                assert bar['text'] == DASH
                assert bar['share'] == 0.0
            else:
                assert bar['text'] == f'{value:.3f} {light.sign}'
                assert bar['share'] == pytest.approx(value / 0.2)


def test_chips_have_a_sign_each_and_one_name():
    """Two states differ by their signs, not only by their colours."""
    states = [HEALTHY, UNCHECKED, EXCLUDED, MISSING, SensorState.UNKNOWN, HEALTHY]
    further = {'insertion': 0.0421, 'gripper': None}
    chips = figures(sensors=6, states=states, further=further)['chips']
    assert [chip['text'] for chip in chips] == [
        'th1A \u2713',
        'th1B ?',
        'th1C \u2715',
        'th3A \u2205',
        'th3B \u2026',
        'th3C \u2713',
        'insertion 42.1 mm',
        'gripper \u2205',
    ]
    assert chips[1]['title'] == 'th1B (joint_1b): not checked by the others'
    assert len({state.sign for state in SensorState}) == len(SensorState)
    assert len({light.sign for light in Light}) == len(Light)


@pytest.fixture(scope='module')
def rows():
    """Return the rows of a device whose joint_1b does not answer."""
    entries = CLEAR | {
        'fkm: orientation': (
            DiagnosticStatus.OK,
            'healthy',
            {
                'mechanism': 'e30770fb',
                'caution': 'joint_1c unchecked for 3 s',
                'protection level (deg)': '0.5',
                'parity (sigma)': '1.2',
            },
        ),
        'encoder_driver: encoders': (
            DiagnosticStatus.WARN,
            'joint_1b: no answer',
            {
                'joint_1a counts': '4711',
                'joint_1a serial number': '1001',
                'joint_1b counts': 'none yet',
                'joint_1b serial number': 'not read',
                'joint_1c counts': '17',
            },
        ),
    }
    return rows_of(
        figures(
            entries,
            teleop='engaged',
            crtk='ENABLED',
            force='engaged',
            torques=(0.2, 0.1),
            readings=(radians(12.5), nan, 0.0, 0.0),
            ages=(0.04, nan, 0.1, 0.2),
        )
    )


@pytest.mark.parametrize(
    ('name', 'words'),
    [
        ('slave', 'engaged'),
        ('CRTK state', 'ENABLED'),
        ('torque', '0.20 N m, rendered 0.10 N m'),
        ('th1A read', '12.500\u00b0, 0.0 s ago'),
        ('th1B read', DASH),
        ('th1A device', 'counts 4711, serial 1001'),
        ('th1B device', 'counts none yet, serial not read'),
        ('th1C device', 'counts 17, no serial on this bus'),
        ('th3A device', 'this source has neither counts nor serials'),
        ('calibration', 'calibrated 2026-11-26'),
        ('mechanism', 'e30770fb'),
        ('alert limit', '2\u00b0'),
        ('protection level', '0.50\u00b0 of 2\u00b0 allowed'),
        # One name for one sensor, wherever its joint is named.
        ('caution', 'th1C unchecked for 3 s'),
        ('encoders', 'th1B: no answer'),
    ],
)
def test_the_figures_of_encoders_clients_and_calibration(rows, name, words):
    assert rows[name] == words


@pytest.mark.parametrize(
    'name',
    ['orientation', 'parity', 'slave', 'torque', 'th1A read', 'th1A device', 'rate', 'latency'],
)
def test_without_a_devices_news_there_are_the_same_rows_with_dashes(rows, name):
    nothing = rows_of(figures(**SILENT))
    assert nothing.keys() == rows.keys()
    assert nothing[name] == DASH


@pytest.fixture(scope='module')
def plotted():
    """Return the plots of a device by their names, and the values that they show."""
    found = figures(CLEAR, torques=(0.2, 0.1), ghost=radians(5.0))
    plots = {plot['key']: plot for plot in found['plots']}
    return plots, found['sample']['values']


def test_each_plot_has_a_value_for_each_of_its_series(plotted):
    plots, values = plotted
    assert plots.keys() == values.keys()
    for key, plot in plots.items():
        assert len(plot['series']) == len(values[key])
    assert values['torque'] == [0.2, 0.1]
    assert values['ghost'] == pytest.approx([5.0])


def test_the_plots_have_named_limits(plotted):
    plots, _ = plotted
    warning, error = plots['dexterity']['limits']
    assert (warning['name'], warning['value']) == ('warning', 0.059)
    assert (error['name'], error['value']) == ('error', 0.033)
    assert [limit['name'] for limit in plots['level']['limits']] == ['alert']
    # What a story is about is at the top of the panel.
    assert [key for key, plot in plots.items() if plot['on_top']] == ['ghost', 'dexterity']


def test_a_silence_is_one_event_however_long_it_lasts(shown):
    """Its log line stays one, and the cause is not pushed out."""
    shown.begin()
    shown.run(1.0, shown.fkm)
    states = []
    for _ in range(6):
        shown.run(1.0)
        states.append(shown.content['sample']['state'])
    assert len(set(states[3:])) == 1
    assert states[-1].startswith('silent: nothing from fkm')
    assert shown.text == 'silent: nothing from fkm, no joint_states for 6 s'


def shown_in_full(shown):
    """Let a device that is healthy have all that is shown of one."""
    shown.begin(
        source='sim',
        sensors=5,
        alert_limit_deg=2.0,
        calibration='made today',
    )
    shown.say('force_state', 'engaged')
    shown.say('teleop_state', 'clutched')
    shown.say('operating_state_text', 'ENABLED')
    shown.say(COVERAGE_TOPIC, '{"text": "turn it", "covered": {"tilt": 0.4, "turn": 1.0}}')

    def healthy():
        shown.readings((0.2, 1.0, 0.8), (0.01, 0.0, 0.0, 0.0))
        shown.torques(servo=0.2, measured=0.1)
        shown.pose(0.2, 1.0, 0.8)
        shown.fkm(**{'parity (sigma)': '1.2'})
        shown.newest['/dexterity'] = Float64MultiArray(data=(0.05, 0.4))

    shown.run(0.5, healthy)
    shown.arm._page.refresh()
    return news_of(shown.server)


def test_a_page_that_opens_gets_all_that_is_shown_of_a_device(serve, shown):
    news = shown_in_full(shown)
    (device,) = news['devices']
    assert device['banner']['text'] == 'healthy'
    assert device['banner']['sign'] == '\u2713'
    assert device['banner']['alive']
    assert news['hasDevice']
    assert device['content']['calibration']['text'] == 'turn it'
    rows = rows_of(device['content'])
    assert rows['slave'] == 'clutched'
    assert rows['CRTK state'] == 'ENABLED'
    assert rows['force'] == 'engaged'
    assert rows['calibration'] == 'made today'
    assert rows['alert limit'] == '2\u00b0'


def test_a_page_that_opens_later_gets_the_newest_news(serve, shown):
    """The device has fallen silent meanwhile."""
    news = shown_in_full(shown)
    shown.say('state', 'silent: joint_1b stuck')
    shown.run(0.25)
    later = news_of(shown.server)
    assert later['clock'] >= news['clock']
    assert later['session'] == news['session']
    (device,) = later['devices']
    assert device['banner'] == {
        'text': 'silent: th1B stuck',
        'light': 'RED',
        'colour': Light.RED.colour,
        'sign': '\u2715',
        'alive': False,
    }


def test_a_heartbeat_of_teleop_that_ends_is_no_lead(serve, shown):
    shown_in_full(shown)
    shown.run(1.25, shown.pose)
    assert shown.rows['slave'] == 'no news from teleop: not led'


def news_of(server):
    """Return the news that a page to come is sent; there is one."""
    messages = server._websock_server.get_message_buffer().message_from_id.values()
    (source,) = [
        message.source
        for message in messages
        if isinstance(message, RunJavascriptMessage) and message.source.startswith(NEWS)
    ]
    return json.loads(source.removeprefix(NEWS).removesuffix(');'))


def test_the_legend_explains_every_sign_of_the_chips_and_the_parts_of_the_picture():
    words = ' '.join(f'{entry.sign} {entry.text}' for entry in legend())
    for sign in (state.sign for state in SensorState if state is not SensorState.UNKNOWN):
        assert sign in words
    for part in ('Dome', 'red line', 'Violet', 'Cone', 'A B C', 'O, the centre', 'self-rotation'):
        assert part in words
    for part in ('Dexterity', 'Parity', 'Protection level', 'torque commanded', 'slave stops'):
        assert part in words


def test_the_page_without_a_device_says_how_to_start_one(serve):
    server = serve(names='empty')
    page = Page(server)
    news = news_of(server)
    assert news['devices'][0]['banner']['text'] == 'no device found. Start it: make run'
    assert not news['hasDevice']
    assert not page.shown


def test_the_script_is_one_call_with_the_setup():
    assert script({'latest': 0.5}).startswith('window.spm ??= ((setup) => {')
    assert script({'latest': 0.5}).endswith('})({"latest": 0.5});')


def test_every_story_has_a_sentence_a_step_and_ends_with_a_verdict():
    for sensors in (4, 6):
        for story in stories(sensors):
            assert all(step.words.endswith('.') for step in story.steps)
            assert story.end > story.steps[-1].at


@pytest.mark.parametrize('state', [*Light, *SensorState])
def test_white_words_are_legible_on_banners_and_chips(state):
    """As WCAG AA wants it of text."""
    assert contrast('#ffffff', state.colour) >= 4.5


@pytest.mark.parametrize('entry', legend(), ids=lambda entry: entry.text)
def test_the_signs_of_the_legend_are_legible_on_both_pages(entry):
    assert contrast(entry.ink.light, WHITE_PAGE) >= 4.5
    assert contrast(entry.ink.dark, DARK_PAGE) >= 4.5
