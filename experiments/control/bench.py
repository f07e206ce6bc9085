"""Time of the barrier controllers on one core: `python experiments/control/bench.py`.

Robots meet in the middle of a walled square among eight people; every tick of the run is
measured. Columns [ms], p50 and p99:

* joint program: assembling all rows and solving one program for all robots, even
  where the reference obeys every row (no fast path, no splitting into components);
* as used: the same with both;
* control(): the whole call with perception, clusters, manoeuvres and commands.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "stack"))
from control_course import Course, box, line

from mrta_falsify.stack.control.cluster import ClusterCbf


def meeting(n: int) -> Course:
    """n robots on a circle, each on its way to the other side."""
    angles = np.arange(n) * 2 * np.pi / max(n, 2)
    starts = [(-4 * np.cos(a), -4 * np.sin(a)) for a in angles]
    rng = np.random.default_rng(n)
    return Course(
        pose=[[*p, a] for p, a in zip(starts, angles, strict=True)],
        paths=[line(p, (-p[0], -p[1]), spacing=0.05) for p in starts],
        walls=box(-5, -5, 5, 5),
        humans=rng.uniform(1.5, 4.5, (8, 2)) * rng.choice([-1, 1], (8, 2)),
        human_velocity=rng.uniform(-0.3, 0.3, (8, 2)),
    )


def spent(function, repeats: int = 3) -> float:
    """Shortest time of a call [ms]."""
    best = np.inf
    for _ in range(repeats):
        begin = time.perf_counter()
        function()
        best = min(best, time.perf_counter() - begin)
    return best * 1e3


def measure(n: int) -> str:
    course, controller = meeting(n), ClusterCbf(ClusterCbf.Options())
    views = []
    for _ in range(400):
        views.append(course.view())
        course.step(controller)
        if course.arrived().all():
            break
    controller = ClusterCbf(ClusterCbf.Options())
    steering = controller.steering
    joint, used, fast = [], [], 0
    for view in views:
        scene = controller.scene(view)

        def together(view=view, scene=scene):
            return steering.solve(steering.program(view, scene).as_one(), always=True)

        def as_used(view=view, scene=scene):
            return steering.solve(steering.program(view, scene))

        joint.append(spent(together))
        used.append(spent(as_used))
        fast += as_used().solved == 0
        controller.control(view)
    controller = ClusterCbf(ClusterCbf.Options())
    whole = [spent(lambda view=view: controller.control(view), 1) for view in views]
    cells = "".join(
        f"{np.percentile(times, 50):9.3f}{np.percentile(times, 99):9.3f}"
        for times in (joint, used, whole)
    )
    return f"{n:6d}{cells}{fast / len(views):9.0%}"


def main() -> None:
    print("robots    joint program         as used       control()   no solver")
    print("            p50      p99      p50      p99      p50      p99")
    measure(2)
    for n in (1, 2, 3, 6):
        print(measure(n))


if __name__ == "__main__":
    main()
