"""Student policy that estimates what its teacher observes, and acts by a copy of the teacher's networks.

Both observe the blocks R (obs_blocks.py) of the same robot, the student along the axes of its start, the teacher along those of the
episode. A point-cloud network estimates the frame of the episode and the teacher's other numbers O, P, N; the copy, which is not
trained, turns them and R into an action. So hands in states that no training has shown get the answer of the teacher, where a
network that learns actions alone would extrapolate. Rapid motor adaptation (Kumar et al. 2021) likewise estimates what its teacher
observes. What clouds show is measured (middle and spread of points, distances from fingertips), and the network corrects it: a new
shape is measured as well as a known one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from afford.grasping.env.obs_blocks import FAR_M, block_slices, obs_blocks
from afford.grasping.rl.cloud_policy import UNIT_M, CloudConfig, CloudPolicy
from afford.grasping.rl.ppo import ActorCritic, PolicyConfig, RunningMeanStd, mlp

LAYOUT = "small"
FLAGS = 3
"""flags after the robot's own numbers (StudentObs)"""
FRAME = 5
"""numbers of a frame: its origin (m), along the axes of the start, and the cosine and sine of its yaw"""
ESTIMATE_WEIGHT = 0.1
"""weight of the mean squared error of the estimates, in units of their spread, beside that of the actions"""
CLIP = 5.0
"""estimates are learned within so many standard deviations; networks clip what they observe there, too"""


class MeanNetwork(nn.Module):
    """Mean action of a policy, without its critic; not trained."""

    def __init__(self, config: PolicyConfig) -> None:
        super().__init__()
        self.config = config
        self.seen = RunningMeanStd(config.observation)
        self.actor = mlp((config.observation, *config.hidden, config.action), config.activation, last=0.01)
        self.requires_grad_(False)

    @staticmethod
    def of(model: ActorCritic) -> MeanNetwork:
        """Copy the networks of a policy."""
        made = MeanNetwork(model.config)
        made.seen.load_state_dict(model.seen.state_dict())
        made.actor.load_state_dict(model.actor.state_dict())
        return made

    def forward(self, obs: Tensor) -> Tensor:
        """(n, d) observations -> (n, m) actions within -1..1."""
        action: Tensor = self.actor(self.seen(obs)).clamp(-1, 1)
        return action


class TeacherCopy(nn.Module):
    """Networks of a teacher and its prior, and the moves of a full action."""

    rates: Tensor

    def __init__(self, teacher: MeanNetwork, prior: MeanNetwork | None, rates: np.ndarray) -> None:
        """`rates` (m,) are the moves of a full action."""
        super().__init__()
        self.teacher, self.prior = teacher, prior
        self.register_buffer("rates", torch.as_tensor(rates, dtype=torch.float32))

    @property
    def described(self) -> dict[str, Any]:
        """Sizes of the networks, as `from_description` reads them."""
        prior = None if self.prior is None else asdict(self.prior.config)
        return {"teacher": asdict(self.teacher.config), "prior": prior}

    @staticmethod
    def from_description(described: Mapping[str, Any]) -> TeacherCopy:
        """Make networks of these sizes, whose weights are to be loaded."""
        teacher, prior = (MeanNetwork(PolicyConfig(**{**sizes, "hidden": tuple(sizes["hidden"])})) if sizes else None
                          for sizes in (described["teacher"], described["prior"]))  # fmt: skip
        if teacher is None:
            raise ValueError("student: expected the sizes of its teacher's network, got none")
        return TeacherCopy(teacher, prior, np.zeros(teacher.config.action))

    def forward(self, obs: Tensor) -> Tensor:
        """(n, d) observations of the teacher -> (n, m) actions within -1..1, along the axes of the episode."""
        action: Tensor = self.teacher(obs)
        if self.prior is None:
            return action
        return (action + self.prior(obs[:, : self.prior.config.observation])).clamp(-1, 1)  # R O P are the first blocks of R O P N


class EstimatingPolicy(nn.Module):
    """Student policy that DAgger trains to estimate what a teacher observes; actions are those of a copy of the teacher."""

    def __init__(self, config: CloudConfig, copy: TeacherCopy, first_look: bool = True) -> None:
        """`config` are the sizes of the point-cloud network; with `first_look`, N_t stays where it was in the beginning.

        ValueError for a teacher or a student of another layout than `small`.
        """
        super().__init__()
        at = block_slices(obs_blocks(LAYOUT, "teacher"))
        width = max(part.stop for part in at.values())
        if copy.teacher.config.observation != width:
            raise ValueError(f"student: expected a teacher that observes {width} numbers (layout {LAYOUT}), got one of "
                             f"{copy.teacher.config.observation}; give the student a network of its own (head=own)")
        self._at, self.own = at, at["phase"].stop
        if config.robot != self.own + FLAGS:
            raise ValueError(f"student: expected the robot's own numbers in the layout {LAYOUT}, {self.own} and {FLAGS} flags, got "
                             f"{config.robot} numbers; set layout={LAYOUT}, or give the student a network of its own (head=own)")
        self.config, self.copy, self.first_look = config, copy, first_look
        self.trunk = CloudPolicy(replace(config, action=FRAME + width - self.own))

    @property
    def seen(self) -> RunningMeanStd:
        """Statistics of the robot's own numbers."""
        return self.trunk.seen

    @property
    def device(self) -> torch.device:
        """Device of the parameters."""
        return self.trunk.device

    def forward(self, robot: Tensor, cloud: Tensor, N: Tensor) -> Tensor:
        """Observations of the student (CloudPolicy.forward) -> (n, m) actions along the axes of the start."""
        return self.act(robot, self.estimate(robot, cloud, N))

    def loss(self, obs: list[Tensor], label: Tensor) -> tuple[Tensor, Tensor]:
        """Loss, and the squared error of the actions, for labels (n, m + e): actions, a frame, the teacher's numbers after R."""
        action, wanted = label.split([self.config.action, label.shape[1] - self.config.action], dim=1)
        found = self.estimate(*obs)
        error = nn.functional.mse_loss(self.act(obs[0], found), action)
        return error + ESTIMATE_WEIGHT * nn.functional.mse_loss(self._scaled(found), self._scaled(wanted).clamp(-CLIP, CLIP)), error

    def estimate(self, robot: Tensor, cloud: Tensor, N: Tensor) -> Tensor:
        """(n, e) a frame, and the teacher's numbers after R, from the observation of the student."""
        mean, spread = self._units()
        found = self.trunk(robot, cloud, N) * spread + mean
        return torch.cat([found[:, :FRAME], found[:, FRAME:] + self._measured(robot, cloud, N, found.detach())], dim=1)

    def act(self, robot: Tensor, estimate: Tensor) -> Tensor:
        """(n, r) the robot's own numbers, (n, e) estimates -> (n, m) actions along the axes of the start."""
        origin, (c, s) = estimate[:, :3], _direction(estimate)
        own, full = robot[:, : self.own], self.copy.rates[:2]
        palm, tips, offset = (own[:, self._at[name]] for name in ("palm", "tips", "offset"))
        moved = {
            "palm": torch.cat([_turned(palm[:, :3] - origin, c, -s), _turned(palm[:, 3:6], c, -s), _turned(palm[:, 6:], c, -s)], 1),
            "tips": torch.cat([_turned(tip - origin, c, -s) for tip in tips.split(3, dim=1)], 1),
            "offset": torch.cat([_turned(offset[:, :2] * full, c, -s) / full, offset[:, 2:]], 1),
        }
        blocks = [moved.get(name, own[:, part]) for name, part in self._at.items() if part.stop <= self.own]
        any_N = robot[:, -1:]  # observed by both
        action = self.copy(torch.cat([*blocks, estimate[:, FRAME:-1], any_N], dim=1))
        return torch.cat([_turned(action[:, :2] * full, c, s) / full, action[:, 2:]], dim=1)

    @torch.no_grad()
    def _measured(self, robot: Tensor, cloud: Tensor, N: Tensor, estimate: Tensor) -> Tensor:
        """(n, e - FRAME) what the clouds show of the teacher's numbers, less their means; 0 for what they do not show.

        With `first_look`, N_t is where it was in the beginning, and is moved by the estimated move of the centre of mass.
        """
        (c, s), (mean, _) = _direction(estimate), self._units()
        palm, tips = robot[:, self._at["palm"]][:, :3], robot[:, self._at["tips"]].unflatten(1, (-1, 3))
        tips, points = tips - palm[:, None], cloud.float()[:, cloud.shape[1] // 2 :]
        N = N.float() + (_turned(estimate[:, FRAME : FRAME + 3], c, s)[:, None] if self.first_look else 0.0)
        seen, any_N = (robot[:, -k, None] for k in (2, 1))
        found, near = {}, torch.cdist(tips, points).argmin(2)
        to_surface = points.gather(1, near[..., None].expand(-1, -1, 3)) - tips
        found["whole"] = _middle_and_spread(points, c, s)
        found["tips_object"] = to_surface.norm(dim=2).clamp(max=FAR_M)
        found["to_surface"] = _turned_all(to_surface, c, -s).clamp(-FAR_M, FAR_M).flatten(1)
        found["negative"] = _middle_and_spread(N, c, s) * any_N
        found["tips_N"] = torch.where(any_N > 0.5, torch.cdist(tips, N).amin(2).clamp(max=FAR_M), FAR_M)
        out = torch.zeros(len(robot), len(mean) - FRAME, device=robot.device)
        for name, value in found.items():
            at = slice(self._at[name].start - self.own, self._at[name].stop - self.own)
            out[:, at] = value - mean[FRAME:][at]
            if name in ("whole", "tips_object", "to_surface"):
                out[:, at] *= seen
        return out

    def _scaled(self, estimate: Tensor) -> Tensor:
        mean, spread = self._units()
        return (estimate - mean) / spread

    def _units(self) -> tuple[Tensor, Tensor]:
        """(e,) mean and spread of estimates: of a frame in UNIT_M, of the other numbers as the teacher has seen them."""
        seen = self.copy.teacher.seen
        mean, spread = seen.mean[self.own :].float(), (seen.var[self.own :] + 1e-8).sqrt().float()
        frame = spread.new_tensor([UNIT_M] * 3 + [1.0] * (FRAME - 3))
        return torch.cat([torch.zeros_like(frame), mean]), torch.cat([frame, spread])


def _direction(estimate: Tensor) -> tuple[Tensor, Tensor]:
    """Cosine and sine (n,) of the yaw of a frame."""
    yaw = estimate[:, 3:FRAME]
    c, s = (yaw / yaw.norm(dim=1, keepdim=True).clamp(min=0.5)).unbind(1)
    return c, s


def _middle_and_spread(points: Tensor, c: Tensor, s: Tensor) -> Tensor:
    """(n, 6) mean and standard deviation of points (n, k, 3), in frames of this yaw."""
    local = _turned_all(points, c, -s)
    return torch.cat([local.mean(1), local.std(1, correction=0)], dim=1)


def _turned_all(v: Tensor, c: Tensor, s: Tensor) -> Tensor:
    """(n, k, 3) vectors turned about the vertical."""
    return _turned(v.transpose(1, 2), c[:, None], s[:, None]).transpose(1, 2)


def _turned(v: Tensor, c: Tensor, s: Tensor) -> Tensor:
    """(n, 2 or 3, ...) vectors turned about the vertical, by an angle of cosine and sine (n,)."""
    x, y = v[:, 0], v[:, 1]
    return torch.cat([torch.stack([c * x - s * y, s * x + c * y], dim=1), v[:, 2:]], dim=1)
