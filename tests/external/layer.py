"""A layer in a process of its own: ``python layer.py HOW``."""

import sys
import time

import numpy as np

from simulator_interface.clients.mrta_stack import serve_layer

HELD: list[bytes] = []


def allocate(message: dict) -> dict:
    """As the shipped `in_turn`: task k to robot k modulo their number."""
    robots = message["robots"]
    routes = [[] for _ in robots]
    carrier = {task: i for i, robot in enumerate(robots) for task in robot["onboard"]}
    for task in sorted(message["tasks"], key=lambda t: (t["number"] not in carrier, t["number"])):
        number = task["number"]
        if number in carrier:
            routes[carrier[number]].append([number, "dropoff"])
        else:
            routes[number % len(robots)] += [[number, "pickup"], [number, "dropoff"]]
    return {"routes": routes}


def answer(message: dict) -> dict:
    match sys.argv[1]:
        case "hangs":
            time.sleep(1e6)
        case "raises":
            raise RuntimeError("a bug of the layer's")
        case "hoards":
            HELD.append(b"x" * (400 << 20))
            time.sleep(1e6)
        case "twice":
            return {"routes": [[[0, "pickup"], [0, "pickup"]] for _ in message["robots"]]}
    match message["type"]:
        case "allocate":
            return allocate(message)
        case "order":
            return {"robots": [w["robot"] for w in sorted(message["waiters"], key=_since)]}
        case "ranks":
            robots = len(np.frombuffer(message["pose"])) // 3
            return {"ranks": list(reversed(range(robots)))}  # the largest number first
    raise ValueError(message["type"])


def _since(waiter: dict) -> tuple:
    return waiter["since"], waiter["robot"]


if __name__ == "__main__":
    serve_layer(answer, name="layer")
