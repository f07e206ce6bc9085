"""The keeper of a stack's process ends when its owner says so, whoever holds its connection."""

import os
import signal
import socket
import sys

import pytest

from mrta_falsify.process.program import Program


@pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux only")
@pytest.mark.timeout(60)
def test_a_copy_of_the_owner_does_not_hold_the_keeper_up(tmp_path):
    ours, link = socket.socketpair()
    keeper = Program(("sleep", "600"), str(tmp_path), os.environ, link)
    assert keeper.error() == ""
    (program,) = keeper.kept()[:1]
    copy = os.fork()
    if copy == 0:
        signal.pause()
    try:
        keeper.close()
        with pytest.raises(ProcessLookupError):
            os.kill(program, 0)
    finally:
        os.kill(copy, signal.SIGKILL)
        os.waitpid(copy, 0)
        ours.close()
        link.close()
