"""Verify a saved run with MuJoCo alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from .runs import load_run
from .views import scene_of


@dataclass(frozen=True, slots=True)
class Replay:
    """Result of replaying a run from its model and set-points alone."""

    ticks: int
    """Rows replayed."""
    position_difference: float
    """Largest difference of qpos [m, rad]."""
    velocity_difference: float
    """Largest difference of qvel [m/s, rad/s]."""


def replay(folder: str | Path) -> Replay:
    """Replay a saved run with MuJoCo alone: first state, then the set-points.

    Args:
        folder: A folder that `Run.save` wrote.

    Returns:
        The largest differences from the record.

    Raises:
        RunError: If the folder is not such a run.
    """
    run = load_run(folder, whole=False)
    model, columns = scene_of(run), run.columns
    data, substeps = mujoco.MjData(model), int(columns["substeps"])
    qpos, qvel, ctrl = (columns[name] for name in ("qpos", "qvel", "ctrl"))
    data.qpos[:], data.qvel[:] = qpos[0], qvel[0]
    if model.na:
        data.act[:] = columns["act"][0]
    worst_q = worst_v = 0.0
    for k in range(len(qpos)):
        worst_q = max(worst_q, float(np.abs(data.qpos - qpos[k]).max()))
        worst_v = max(worst_v, float(np.abs(data.qvel - qvel[k]).max()))
        data.ctrl[:] = ctrl[k]
        if "xfrc_applied" in columns:
            data.xfrc_applied[:] = columns["xfrc_applied"][k]
        mujoco.mj_step(model, data, substeps)
    return Replay(len(qpos), worst_q, worst_v)
