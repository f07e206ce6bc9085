"""The environment: one episode after the other, a control tick a step."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from pettingzoo import ParallelEnv

from mrta_falsify.commands.folders import Place
from mrta_falsify.commands.stacks import Stack, load_stack
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import ConfigError, WorldError
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.protocols import ControlResult, ControlView
from mrta_falsify.core.world import World
from mrta_falsify.gym.drawing import PlayedWorld, WorldSource
from mrta_falsify.gym.episode_end import EpisodeEnd, episode_end
from mrta_falsify.specs.library import spec_names
from mrta_falsify.stack.policy.observation import ACTIONS, Observations, bounds, observe, twists_of
from mrta_falsify.stack.policy.policy_controller import on_their_own
from mrta_falsify.trial import Job, TrialWatch, campaign_specifications, judges_of, summed_up
from simulator_interface.simulate import EpisodeRun


class AwaitedActions:
    """Answers with a command at rest, which :meth:`act` fills before the frame is used.

    Nothing that a stack says beside the command depends on it. So the frame with the filled
    command is the one that a controller would have made that knew the actions at once.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """No options."""

    def __init__(self, options: Options) -> None:
        del options
        self.view: ControlView | None = None  #: of the last tick
        self._twist = np.zeros((0, 3))

    def control(self, view: ControlView) -> ControlResult:
        """See :class:`~mrta_falsify.core.protocols.Controller`."""
        self.view, self._twist = view, np.zeros((len(view.pose), 3))
        return on_their_own(self._twist)

    def act(self, actions: Array) -> None:
        """Decide the command of the last tick by ``actions`` ``(N, 2)``."""
        assert self.view is not None, "it was asked"
        self._twist[:] = twists_of(actions, self.view)


CONTACT_COST = 1.0  # m of progress that a tick in contact costs
AWAITED = "mrta_falsify.gym.fleet_env:AwaitedActions"
#: judged by asking the stack again, which cannot be done to a policy outside
NEEDS_COPIES = ("repeatable",)

Infos = dict[str, dict[str, Any]]
Step = tuple[dict[str, Observations], dict[str, float], dict[str, bool], dict[str, bool], Infos]


class FleetEnv(ParallelEnv[str, Observations, Any]):  # type: ignore[misc]  # has no types here
    """Robots are agents, observations and actions those of :mod:`mrta_falsify.stack.policy`.

    A step is a control tick. The reward is the way [m] that a robot came nearer to the point that
    it should steer for, less 1 for a tick in which it touches anything. An episode ends for all
    robots at once: terminated if all tasks are done, the stack failed or a violation decided it;
    truncated at the horizon.

    Args:
        source: see :func:`mrta_falsify.gym.parallel_env`.
        stack: likewise, and so on.
        settings: of it.
        specs: names of specifications.
        early_stop: end soon after the first violation.
    """

    metadata = {"name": "mrta_falsify_fleet", "render_modes": [], "is_parallelizable": True}  # noqa: RUF012 - as PettingZoo declares it

    def __init__(
        self,
        source: World | Place,
        stack: Stack | None,
        *,
        settings: Sequence[str],
        specs: str | Sequence[str],
        early_stop: bool,
    ) -> None:
        self.render_mode = None
        self.config = _with_actions_awaited(load_stack(stack, settings))
        chosen = spec_names(specs) or campaign_specifications(self.config)
        self.specs = tuple(name for name in chosen if name not in NEEDS_COPIES)
        self.early_stop = early_stop
        self._source = WorldSource(source)
        self.space = self._source.space  #: what ``options["u"]`` is a point of
        self.possible_agents = [robot.name for robot in self._source.first().robots]
        self.agents: list[str] = []
        low, high = bounds()
        self._seen = {name: Box(low, high, dtype=np.float32) for name in self.possible_agents}
        self._acts = {name: Box(-1.0, 1.0, (ACTIONS,), np.float32) for name in self.possible_agents}
        self.played: PlayedWorld | None = None  #: the world of the episode
        self._run: EpisodeRun | None = None
        self._watch: TrialWatch | None = None
        self._frame: Frame | None = None

    def observation_space(self, agent: str) -> Box:
        """Give the space of a robot's observations, always the same object."""
        return self._seen[agent]

    def action_space(self, agent: str) -> Box:
        """Give the space of a robot's actions, always the same object."""
        return self._acts[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observations], Infos]:
        """Begin an episode.

        Args:
            seed: as of a campaign; episodes are counted from 0 from here on. None: count on.
            options: ``u``, a point of the program's cube, or ``world``, a world or its file;
                others are not looked at.

        Returns:
            Observations, and infos with ``world_digest`` and ``u``, realised.

        Raises:
            RejectedScene: the program has no valid scene near ``u``.
            InputError: an option cannot be used, or the world has other robots.
        """
        self.close()
        self.played = self._source.draw(seed, options or {})
        world = self.played.world
        names = [robot.name for robot in world.robots]
        if names != self.possible_agents:
            raise WorldError(
                f"{world.name}: has the robots {', '.join(names)}; this environment was made "
                f"for {', '.join(self.possible_agents)}"
            )
        job = Job(
            world=world,
            config=self.config,
            specifications=self.specs,
            early_stop=self.early_stop,
        )
        judges = judges_of(job)
        self._watch = TrialWatch(job, judges)
        self._run = EpisodeRun(
            world, self.config, specifications=judges, stop=self._watch.stop, copies=False
        )
        self._frame = self._run.look()
        if self._run.ended:
            raise WorldError(f"{world.name}: the stack ended at once: {self._run.ended}")
        self.agents = names
        point = None if self.played.u is None else tuple(self.played.u.tolist())
        infos = {name: {"world_digest": world.digest(), "u": point} for name in names}
        return self._observations(), infos

    def step(self, actions: Mapping[str, Any]) -> Step:
        """Take the next control tick; a robot without an action stands.

        Returns:
            Observations, rewards, terminations, truncations, infos. At the last step
            ``infos[robot]["end"]`` is an :class:`EpisodeEnd`.

        Raises:
            ConfigError: there is no episode, or an action is not two finite numbers.
        """
        run, before = self._run, self._frame
        if run is None or before is None or not self.agents:
            raise ConfigError("step: no episode is going on; call reset() first")
        awaited, names = self._awaited(), self.agents
        awaited.act(np.array([_as_action(name, actions.get(name)) for name in names]))
        assert awaited.view is not None, "it was asked"
        target = awaited.view.target
        run.take_in(before)
        if not run.ended:
            self._frame = run.look()
        assert self._frame is not None, "an episode has a frame"
        rewards = _rewards(before, self._frame, target)
        is_cut = run.ended == "horizon"
        infos: Infos = {name: {} for name in names}
        if run.ended:
            end = self._end()
            infos = {name: {"end": end} for name in names}
            self.agents = []
        return (
            self._observations(),
            dict(zip(names, rewards.tolist(), strict=True)),
            dict.fromkeys(names, bool(run.ended) and not is_cut),
            dict.fromkeys(names, is_cut),
            infos,
        )

    def close(self) -> None:
        """Free the engine; may be called twice, and before :meth:`reset`."""
        if self._run is not None:
            self._run.close()
        self._run, self.agents = None, []

    def render(self) -> None:
        """Draw nothing; ``mrta-falsify run`` draws a world under a policy."""

    def _awaited(self) -> AwaitedActions:
        assert self._run is not None, "an episode goes on"
        controller = self._run.episode.state.controller
        assert isinstance(controller, AwaitedActions), "it was configured"
        return controller

    def _observations(self) -> dict[str, Observations]:
        view = self._awaited().view
        assert view is not None, "it was asked"
        return dict(zip(self.possible_agents, observe(view), strict=True))

    def _end(self) -> EpisodeEnd:
        assert self._run is not None and self._watch is not None  # noqa: PT018 - one state
        return episode_end(summed_up(self._run.outcome(), self._watch))


def _with_actions_awaited(config: StackConfig) -> StackConfig:
    if config.stack is not None:
        raise ConfigError(
            "parallel_env: the stack runs in a process of its own; give one with a controller"
        )
    return dataclasses.replace(config, controller=Choice(AWAITED))


def _as_action(name: str, action: Any) -> Array:
    if action is None:
        return np.zeros(ACTIONS)
    found = np.asarray(action, dtype=np.float64)
    if found.shape != (ACTIONS,) or not np.isfinite(found).all():
        raise ConfigError(f"step: the action of {name} is {action!r}; it must be 2 finite numbers")
    return found


def _rewards(before: Frame, after: Frame, target: Array) -> Array:
    """Compute the rewards ``(N,)`` of one tick, from true poses."""
    start, end = before.sensed.pose[:, :2], after.sensed.pose[:, :2]
    nearer = np.hypot(*(target - start).T) - np.hypot(*(target - end).T)
    touched = after.sensed.contact.any(axis=1)
    reward: Array = np.where(np.isfinite(nearer), nearer, 0.0) - CONTACT_COST * touched
    return reward
