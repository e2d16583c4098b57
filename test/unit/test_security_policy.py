# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The SROS2 policy has the form that ros2 security takes, and is the newest."""

from pathlib import Path
import re
import xml.etree.ElementTree as ET

import pytest
from somfusion_ros.ros.common.security_policy import allowed, main, NODES, policy

ROOT = Path(__file__).parents[2]
# What stands where in a policy of version 0.2.0: children and attributes by tag.
FORM = {'policy': ({'enclaves'}, {'version'}), 'enclaves': ({'enclave'}, set()),
        'enclave': ({'profiles'}, {'path'}), 'profiles': ({'profile'}, set()),
        'profile': ({'topics', 'services', 'actions'}, {'ns', 'node'}),
        'topics': ({'topic'}, {'publish', 'subscribe'}),
        'services': ({'service'}, {'reply', 'request'}),
        'topic': (set(), set()), 'service': (set(), set())}
LEAVES = {'topic', 'service'}
NAME = re.compile(r'/([a-z][a-z0-9_]*|\*)(/([a-z][a-z0-9_]*|\*))*')


def faults_of(text: str) -> list[str]:
    """Say what ros2 security would not take."""
    found = []
    root = ET.fromstring(text)
    if root.tag != 'policy' or root.get('version') != '0.2.0':
        found.append('no policy of version 0.2.0')
    for element in root.iter():
        children, attributes = FORM.get(element.tag, (set(), set()))
        if element.tag not in FORM:
            found.append(f'<{element.tag}>')
        found += [f'<{child.tag}> in <{element.tag}>' for child in element
                  if child.tag not in children]
        found += [f'{name} of <{element.tag}>' for name in {*element.keys()} - attributes]
        if element.tag in LEAVES:
            if not NAME.fullmatch(element.text or ''):
                found.append(f'{element.text!r} is no name')
        elif not len(element):
            found.append(f'an empty <{element.tag}>')
        if element.tag in ('topics', 'services') and (
                not element.keys() or {*element.attrib.values()} - {'ALLOW', 'DENY'}):
            found.append(f'<{element.tag}> allows or denies nothing')
    return found


def test_the_policy_has_the_form_that_ros2_security_takes() -> None:
    text = policy(['robot1', 'robot2'])
    assert not faults_of(text)
    enclaves = [one.get('path') for one in ET.fromstring(text).iter('enclave')]
    assert enclaves == [f'/{robot}/{node}' for robot in ('robot1', 'robot2') for node in NODES]


@pytest.mark.parametrize(('old', 'new'), [
    ('publish="ALLOW"', 'publish="YES"'), ('enclaves>', 'contexts>'), ('0.2.0', '0.1.0'),
    ('<topic>/robot1/map</topic>', '<topic>map topic</topic>'), (' node=', ' name=')])
def test_what_ros2_security_would_not_take_is_found(old: str, new: str) -> None:
    assert faults_of(policy(['robot1']).replace(old, new))


def test_the_example_is_the_newest() -> None:
    """`python -m somfusion_ros.ros.common.security_policy robot1 robot2` renews it."""
    path = ROOT / 'config' / 'sros2_policy.xml'
    assert path.read_text(encoding='utf-8') == policy(['robot1', 'robot2'])


@pytest.mark.parametrize('robots', [['--help'], [], ['robot-1'], ['2nd'], ['a b']])
def test_what_is_no_robot_gets_no_policy(robots: list[str],
                                         capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(robots)
    assert '<policy' not in capsys.readouterr().out


def test_a_name_with_slashes_around_is_the_name(capsys: pytest.CaptureFixture[str]) -> None:
    main(['/robot1/'])
    assert capsys.readouterr().out == policy(['robot1'])


def test_no_robot_speaks_under_the_name_of_another() -> None:
    shared = {'/rosout', '/parameter_events', '/diagnostics', '/tf'}
    for node in NODES:
        may = allowed('robot1', node)
        assert all(name.startswith('/robot1/') for name in {*may.publish, *may.reply} - shared)
        assert '/robot2/map' not in may.publish
