"""A stack that fails in a given way at a given tick: ``python bad_stack.py HOW TICK``."""

import os
import signal
import socket
import subprocess
import sys
import time

import numpy as np

from simulator_interface.clients import mrta_stack

HOW, AT = sys.argv[1], int(sys.argv[2])


class Bad:
    def __init__(self, world, harness):
        self.robots = len(world["robots"])
        self.harness = harness
        if HOW == "refuses":
            sys.exit("no world like this")
        if HOW == "asks":
            harness.plan((0.0, float("nan")), (1.0, 1.0))
        if HOW == "once":
            try:
                os.close(os.open(os.environ["MARK"], os.O_CREAT | os.O_EXCL))
            except FileExistsError:
                sys.exit("I start only once")
        if HOW == "children":
            subprocess.Popen([sys.executable, "-c", "import time; time.sleep(1000)"])
            subprocess.Popen(
                [sys.executable, "-c", "import os, time; os.setsid(); time.sleep(1000)"]
            )

    def step(self, tick):
        answer = {"twist": np.zeros((self.robots, 3))}
        return answer if tick["tick"] < AT else self.fail(answer)

    def fail(self, answer):
        print("about to", HOW)
        match HOW:
            case "raise":
                raise RuntimeError("a bug of the stack's")
            case "exit":
                os._exit(3)
            case "abort":
                os.abort()
            case "hang":
                time.sleep(1e6)
            case "spin":
                while True:
                    pass
            case "stops":
                os.kill(os.getpid(), signal.SIGSTOP)
            case "child spins":
                subprocess.run([sys.executable, "-S", "-c", "while True: pass"], check=True)
            case "inquires":
                while True:
                    self.harness.visible((0.0, 0.0), (1.0, 1.0))
            case "dawdles":
                while True:
                    time.sleep(0.1)
                    self.harness.visible((0.0, 0.0), (1.0, 1.0))
            case "signal":
                os.kill(os.getpid(), 40)  # has no name
            case "nan":
                answer["twist"][-1, 0] = np.nan
            case "shape":
                answer["twist"] = answer["twist"][:, :2]
            case "field":
                answer["twists"] = 1
            case "event":
                answer["events"] = [{"kind": "picked-up", "robot": 99, "task": 0}]
            case "prints":
                os.write(int(os.environ["MRTA_STACK_FD"]), b"hello world, I print\n" * 10)
            case "tick":
                answer["tick"] = 7
            case "closes":
                os.close(int(os.environ["MRTA_STACK_FD"]))
                time.sleep(1e6)
            case "ends slowly":
                connection = socket.socket(fileno=os.dup(int(os.environ["MRTA_STACK_FD"])))
                connection.shutdown(socket.SHUT_RDWR)
                time.sleep(1.5)
                raise RuntimeError("a bug of the stack's")
            case "floods":
                sys.stdout.write("x" * (64 << 20))
                os._exit(4)
            case "eats":
                self.eaten = b"x" * (400 << 20)
            case "hoards":
                while True:
                    self.eaten = [*getattr(self, "eaten", ()), b"x" * (8 << 20)]
                    time.sleep(0.01)
            case "child eats":
                program = f"import time; eaten = b'x' * {400 << 20}; time.sleep(1000)"
                self.child = subprocess.Popen([sys.executable, "-c", program])
                time.sleep(0.5)
            case "noise":
                answer["twist"][0, 0] = np.random.default_rng().normal() * 1e-9
        return answer


if __name__ == "__main__":
    if HOW == "silent":
        time.sleep(1e6)
    if HOW == "old":
        mrta_stack.PROTOCOL = (9, 0)
    mrta_stack.serve(Bad, name="bad", says=("goals",))
