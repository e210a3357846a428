"""Description of a loaded robot: as a profile, and as numbers and texts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from ..embedding import sigma_min
from ..robot import (
    LEGS,
    Kinematics,
    Limits,
    Profile,
    Robot,
    ServoGains,
    SoleNumbers,
    Stance,
    sole_numbers,
)
from ..robot.loaders import first_of
from ..sides import Side
from .defaults import default_gait, default_pendulum
from .doctor import Finding, default_walk, findings, missing_limits


def profile_of(robot: Robot) -> Profile:
    """Return the profile that says all that was found out about a robot.

    Args:
        robot: The robot.

    Returns:
        The profile; loaded with it, the robot is the same. A model that marks its
        frames itself takes home, servos and limits only.
    """
    anatomy = robot.anatomy
    own = robot.model.dof_damping[6:]
    damping = np.maximum(robot.servo.damping - own, 0.0).tolist()
    gains = zip(robot.servo.stiffness.tolist(), damping, strict=True)
    rotors = robot.model.dof_armature[6:].tolist()
    rows = zip(robot.joints, gains, rotors, strict=True)
    joints: dict[str, Any] = {
        "home": {name: round(q, 6) for name, q in robot.home_angles.items()},
        "servo": {
            name: ServoGains(_digits(k), _digits(d), _digits(rotor) or None)
            for name, (k, d), rotor in rows
        },
        "limits": _limits(robot),
    }
    if anatomy.marked:
        return Profile(**joints)
    return Profile(
        forward=math.degrees(anatomy.forward),
        imu=anatomy.imu,
        torso=anatomy.torso,
        head=anatomy.head,
        locked=anatomy.locked,
        legs={s: _with_followers(robot, leg) for s, leg in anatomy.legs.items()},
        arms={s: _with_followers(robot, arm) for s, arm in anatomy.arms.items()},
        soles={
            side: SoleNumbers(**{k: round(x, 6) for k, x in sole_numbers(sole).items()})
            for side, sole in anatomy.soles.items()
        },
        stance=Stance(
            com_height=_digits(robot.com_height),
            half_width=_digits(0.5 * robot.stance_width),
        ),
        **joints,
    )


def _with_followers(robot: Robot, joints: tuple[str, ...]) -> tuple[str, ...]:
    more = [m.joint for m in robot.anatomy.coupled if m.primary in joints]
    return tuple(sorted({*joints, *more}, key=robot.joints.index))


def _limits(robot: Robot) -> dict[str, Limits]:
    """Return the limits of all joints, as far as there are any."""
    columns = (robot.lower, robot.upper, robot.speed, robot.torque)
    found = {}
    for j, name in enumerate(robot.joints):
        numbers = [float(x[j]) for x in columns]
        lower, upper, speed, torque = (
            _digits(x) if math.isfinite(x) else None for x in numbers
        )
        limits = Limits(lower=lower, upper=upper, speed=speed, torque=torque)
        if limits != Limits():
            found[name] = limits
    return found


def describe(robot: Robot) -> dict[str, Any]:
    """Describe a robot, ready for JSON.

    Args:
        robot: The robot.

    Returns:
        Numbers, names of joints by part, soles, servos, limits, gait, notes, and
        findings, worst first.
    """
    anatomy = robot.anatomy
    parts = {f"{side}_leg": list(anatomy.legs[side]) for side in Side}
    parts |= {f"{side}_arm": list(joints) for side, joints in anatomy.arms.items()}
    parts |= {"torso": list(anatomy.torso), "head": list(anatomy.head)}
    return {
        "name": robot.name,
        "mass_kg": round(robot.mass, 3),
        "com_height_m": round(robot.com_height, 4),
        "forward_deg": round(math.degrees(anatomy.forward), 3),
        "joints": len(robot.joints),
        "parts": parts,
        "locked": list(anatomy.locked),
        "follow": {
            m.joint: {"leader": m.primary, "ratio": m.ratio, "offset_rad": m.offset}
            for m in anatomy.coupled
        },
        "imu": anatomy.imu,
        "soles": _soles(robot),
        "bend_rad": round(_bend(robot), 4),
        "home_rad": {k: round(q, 4) for k, q in robot.home_angles.items()},
        "actuation": str(robot.actuation),
        "servos": _servos(robot),
        "missing_limits": missing_limits(robot),
        "roles": {role: joint for role, (joint, _) in robot.roles.items()},
        "gait": _gait(robot),
        "findings": [asdict(finding) for finding in findings(robot)],
        "notes": list(robot.notes),
    }


def _soles(robot: Robot) -> dict[str, Any]:
    """Return size, place and origin of the soles."""
    found = {}
    for side, sole in robot.anatomy.soles.items():
        numbers = {f"{k}_m": round(x, 5) for k, x in sole_numbers(sole).items()}
        found[str(side)] = {**numbers, "body": sole.body, "from": sole.origin}
    return found


def _servos(robot: Robot) -> dict[str, dict[str, float | bool]]:
    """Return the servos by joint."""
    designed, servo = set(robot.anatomy.designed), robot.servo
    return {
        name: {
            "stiffness": _digits(servo.stiffness[j]),
            "damping": _digits(servo.damping[j]),
            "armature": _digits(robot.model.dof_armature[6 + j]),
            "designed": name in designed,
        }
        for j, name in enumerate(robot.joints)
    }


def _gait(robot: Robot) -> dict[str, Any]:
    """Return the gait that the robot walks with unless told otherwise, or why not."""
    gait = default_gait(robot)
    return {
        "fault": default_walk(robot)[1],
        "speed_m_s": _digits(gait.speed),
        "step_length_m": _digits(gait.step_length),
        "step_time_s": gait.period,
        "step_width_m": _digits(2.0 * gait.half_width),
        "pendulum_height_m": default_pendulum(robot).height,
    }


def _bend(robot: Robot) -> float:
    """Return the distance of the legs from singularity, as `posture.BEND`."""
    kinematics = Kinematics(robot)
    posture, found = kinematics.posture(robot.home), []
    for i, limb in enumerate(robot.limbs):
        if limb.name in LEGS.values():
            anchors = kinematics.data.xanchor[np.array(limb.joints) + 1]
            length = float(np.linalg.norm(np.diff(anchors, axis=0), axis=1).sum())
            J = posture.jacobian[3 + 6 * i : 9 + 6 * i, limb.columns].copy()
            J[:3] /= length
            square = J.shape[1] == 6
            found.append(
                sigma_min(J) if square else np.linalg.svd(J, compute_uv=False)[-1]
            )
    return float(min(found))


def _ends(robot: Robot) -> np.ndarray:
    """Return where the limbs end in the walking posture [m], the legs first."""
    return Kinematics(robot).posture(robot.home).ends


def _digits(x: float) -> float:
    return float(f"{x:.7g}")


# ---- For tables -------------------------------------------------------------------


def rows_of(facts: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return a description as rows of a table.

    Args:
        facts: What it returned.

    Returns:
        Name and text of each row; empty texts are left out.
    """
    rows = [
        ("robot", f"{facts['name']}, {facts['joints']} joints"),
        ("mass", f"{facts['mass_kg']:.2f} kg"),
        ("CoM height", f"{facts['com_height_m']:.3f} m, in the walking posture"),
        ("forward", f"{facts['forward_deg']:.1f} deg in the file"),
    ]
    parts: dict[str, list[str]] = facts["parts"]
    for part, joints in parts.items():
        rows.append((part.replace("_", " "), _listed(joints) or "none"))
    rows.append(("locked", _listed(facts["locked"])))
    rows.append(("follow others", _listed(facts["follow"])))
    rows.append(("IMU on", facts["imu"]))
    soles = {side: _sole_text(sole) for side, sole in facts["soles"].items()}
    rows += [(f"{side} sole", text) for side, text in soles.items()]
    rows.append(("joints take", _TAKEN[facts["actuation"]]))
    rows += _servo_rows(facts)
    for what, joints in facts["missing_limits"].items():
        rows.append((f"no {what} limit", first_of(joints) if joints else ""))
    gait = facts["gait"]
    rows.append(
        (
            "walks by default",
            f"{gait['speed_m_s']:.3f} m/s: steps of {gait['step_length_m']:.3f} m in "
            f"{gait['step_time_s']:.3g} s, feet {gait['step_width_m']:.3f} m apart"
            if gait["fault"] is None
            else f"no gait fits, not even in place; of the usual one, {gait['fault']}",
        )
    )
    rows += [(found["level"], str(Finding(**found))) for found in facts["findings"]]
    return [(name, text) for name, text in rows if text]


_TAKEN = {
    "position": "positions (--actuation position)",
    "pd": "torques, with gains about positions (--actuation pd)",
    "torque": "torques alone (--actuation torque)",
}


def _listed(names: Iterable[str]) -> str:
    every = list(names)
    more = f"{len(every)}: " if len(every) > 4 else ""
    return more + (", ".join(every) if len(every) < 8 else first_of(every, 6))


def _sole_text(sole: Mapping[str, Any]) -> str:
    """Return size and origin of a sole."""
    return (
        f"{1e3 * sole['length_m']:.0f} x {1e3 * sole['width_m']:.0f} mm on "
        f"{sole['body']}, {1e3 * sole['height_m']:.0f} mm under the ankle; from "
        f"{sole['from']}"
    )


def _servo_rows(facts: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return a row on the servos of the legs, and one on all others."""
    legs = [j for side in Side for j in facts["parts"][f"{side}_leg"]]
    servos = facts["servos"]
    others = [j for j in servos if j not in legs]
    return [
        ("servos of the legs", _servo_text([servos[j] for j in legs])),
        ("other servos", _servo_text([servos[j] for j in others])),
    ]


def _servo_text(servos: list[Mapping[str, Any]]) -> str:
    """Return the span of the gains of some servos, and whose they are."""
    if not servos:
        return ""
    gains = [s["stiffness"] for s in servos]
    low, high = min(gains), max(gains)
    span = f"{low:.5g}" if low == high else f"{low:.3g} to {high:.5g}"
    made = {s["designed"] for s in servos}
    whose = (
        "designed" if made == {True} else "of the file" if made == {False} else "both"
    )
    return f"{span} N m/rad, {whose}"
