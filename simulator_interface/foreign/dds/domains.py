"""DDS domains of this machine: one for each bridge, and nothing that leaves the machine."""

from __future__ import annotations

import os
import socket

from mrta_falsify.core.errors import ConfigError
from simulator_interface.foreign.dds.bridge_settings import MAX_DOMAINS

FIRST = 41  # lower ones are what people set by hand
#: participants that can be found without multicast: the ports of a domain suffice for no more
MAX_PARTICIPANTS = 119
#: of Cyclone DDS: the loopback interface and unicast only
LOOPBACK = f"""<CycloneDDS><Domain id="any">
<General>
<Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/></Interfaces>
<AllowMulticast>false</AllowMulticast>
</General>
<Discovery>
<ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>{MAX_PARTICIPANTS}</MaxAutoParticipantIndex>
<Peers><Peer Address="127.0.0.1"/></Peers>
</Discovery>
</Domain></CycloneDDS>"""
#: the bridge's own: who starts later than it, and listens to unicast only, hears of it soon
ANNOUNCING = LOOPBACK.replace("</Discovery>", "<SPDPInterval>1s</SPDPInterval></Discovery>")


class ReservedDomain:
    """A domain that no other bridge on this machine uses while ``hold`` is open anywhere.

    Args:
        wanted: its number, None: any that is free.

    Raises:
        ConfigError: another bridge uses it, or there is none left.
    """

    def __init__(self, wanted: int | None) -> None:
        numbers = range(MAX_DOMAINS, FIRST - 1, -1) if wanted is None else [wanted]
        for number in numbers:
            self.hold = socket.socket(socket.AF_UNIX)  #: handed on to the nodes as well
            try:
                # A name in Linux' abstract space goes when the last process that has it ends.
                self.hold.bind(f"\0mrta-falsify-dds-{number}")
            except OSError:
                self.hold.close()
                continue
            self.number = number
            return
        if wanted is None:
            raise ConfigError(f"domains {FIRST} to {MAX_DOMAINS} are all used by other bridges")
        raise ConfigError(
            f"domain {wanted} is used by another bridge; each run needs one of its own: leave out "
            "`domain`, and let the bridge start the nodes (`commands`)"
        )


def environment(domain: int) -> dict[str, str]:
    """Give the environment by which nodes find this domain and stay on this machine."""
    found = {
        **os.environ,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",  # Iron and later
        "CYCLONEDDS_URI": LOOPBACK,
        "ROS_LOCALHOST_ONLY": "1",  # Humble
    }
    if found.get("RMW_IMPLEMENTATION") == "rmw_cyclonedds_cpp":
        # It would choose the loopback interface once more, which Cyclone DDS refuses.
        del found["ROS_LOCALHOST_ONLY"]
    return found
