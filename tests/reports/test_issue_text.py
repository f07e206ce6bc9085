"""The text of an issue."""

from __future__ import annotations

import dataclasses

from reports.issue_text import MAX_LINES, IssueContents, render_issue

ISSUE = IssueContents(
    signature="no_deadlock/2:barrier>barrier",
    happened=("robot1 and robot2 <wait> for each other.", "robot1 waits for robot2.", "More."),
    program="model scenic_worlds.model\nnew Robot\n",
    about_world="The smallest world found after 12 runs.",
    commands=(("Run the world", "mrta-falsify run world.json --stack stack.yaml"),),
    versions=(("numpy", "2.0"), ("python", "3.11")),
    pictures=(("The run", "run.gif"),),
    formats=(("Nav2", "nav2/"),),
    missing=("MRTA-Sim: cannot be written",),
    facts=(("world digest", "abc"),),
)


def test_it_says_what_happened_in_two_sentences_and_shows_the_world():
    text = render_issue(ISSUE)
    assert text.startswith(
        "# robot1 and robot2 &lt;wait&gt; for each other.\n\nrobot1 waits for robot2.\n"
    )
    assert "More." not in text
    assert "```scenic\nmodel scenic_worlds.model\nnew Robot\n```" in text
    assert "```\nmrta-falsify run world.json --stack stack.yaml\n```" in text
    for part in ("![The run](run.gif)", "- Nav2: `nav2/`", "MRTA-Sim: cannot", "numpy 2.0, python"):
        assert part in text


def test_a_long_world_is_left_beside_the_text():
    program = "new Robot\n" * (MAX_LINES + 1)
    text = render_issue(dataclasses.replace(ISSUE, program=program))
    assert f"It has {MAX_LINES + 1} lines" in text
    assert "new Robot" not in text


def test_a_fence_in_the_world_does_not_end_its_block():
    text = render_issue(dataclasses.replace(ISSUE, program="'''\n```\nafter\n'''\n"))
    assert "````scenic\n'''\n```\nafter\n'''\n````" in text
