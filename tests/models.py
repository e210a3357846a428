"""Humanoids of any build as URDF text: what is found must not depend on names."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

LEG = ("hip_z", "hip_x", "hip_y", "knee_y", "ankle_y", "ankle_x")
"""Joints of a leg: place and axis."""
ARM = ("shoulder_y", "shoulder_x", "shoulder_z", "elbow_y", "wrist_z")
"""Joints of an arm."""
_DROPS = {"hip": 0.0, "knee": -0.4, "knee2": -0.03, "ankle": -0.4, "toe": -0.06}
_DROPS |= {"shoulder": 0.0, "elbow": -0.25, "wrist": -0.22}
_AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
_POSES = {"down": (0.0, 0.0), "tee": (0.5 * math.pi, 0.0), "forward": (0.0, -1.57)}


@dataclass(frozen=True, kw_only=True)
class Build:
    """How a humanoid is built."""

    scale: float = 1.0
    """Factor on all lengths; masses grow with its cube. At 1: legs of 0.8 m, 60 kg."""
    leg: tuple[str, ...] = LEG
    """Joints of each leg."""
    arms: tuple[str, ...] = ("left", "right")
    """Sides that have an arm."""
    arm: tuple[str, ...] = ARM
    """Joints of each arm."""
    pose: str = "down"
    """How the arms are at zero: down, tee, forward."""
    fingers: int = 0
    """Fingers on each hand, of two joints."""
    waist: tuple[str, ...] = ("z", "y")
    """Axes of the joints between pelvis and chest."""
    neck: tuple[str, ...] = ("z", "y")
    """Axes of the joints of the head; no head if empty."""
    tail: bool = False
    """Whether it has a tail of two joints."""
    backpack: bool = False
    """Whether it has a box on a joint on its back."""
    chest_first: bool = False
    """Whether the chest is the base, and the pelvis hangs below a joint."""
    foot: str = "box"
    """Shape of the feet: box, none, mesh (a file that does not exist), ball."""
    yaw: float = 0.0
    """Where forward is in the file [rad]."""
    uneven: float = 0.0
    """How much longer the left shank is [m], at scale 1."""
    mimic: dict[str, tuple[str, float, float]] = field(default_factory=dict)
    """Joints that follow, without side: leader, ratio, offset."""
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Limits of joints [rad], without side."""
    slide: tuple[str, ...] = ()
    """Joints that slide, without side."""
    seed: int | None = None
    """Names and the order of joints are random with this seed."""
    legs: int = 2
    """Number of legs: two, none, one, or four."""
    effort: float = 400.0
    """Torque limits at scale 1 [N m]."""


class _Writer:
    """Collects links and joints."""

    def __init__(self, build: Build) -> None:
        self.build, self.links, self.joints = build, [], []

    def link(self, name, mass, com=(0, 0, 0), size=(0.1, 0.1, 0.1), shape="") -> str:
        """Add a link: a box of uniform density."""
        s = self.build.scale
        m, com = mass * s**3, np.multiply(com, s)
        x, y, z = np.multiply(size, s) ** 2 * m / 12.0
        self.links.append(
            f'<link name="{name}"><inertial><origin xyz="{_text(com)}"/>'
            f'<mass value="{m:.9g}"/><inertia ixx="{y + z:.9g}" iyy="{x + z:.9g}" '
            f'izz="{x + y:.9g}" ixy="0" ixz="0" iyz="0"/></inertial>{shape}</link>'
        )
        return name

    def joint(self, name, parent, child, place, axis, key="", rpy=(0, 0, 0)) -> None:
        """Add a joint that moves; the key finds its options."""
        low, high = self.build.limits.get(key, (-2.5, 2.5))
        s = self.build.scale
        kind = "prismatic" if key in self.build.slide else "revolute"
        mimic, side = "", name[: len(name) - len(key)]
        if key in self.build.mimic:
            leader, ratio, offset = self.build.mimic[key]
            mimic = (
                f'<mimic joint="{side}{leader}" multiplier="{ratio}" '
                f'offset="{offset}"/>'
            )
        self.joints.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{child}"/>'
            f'<origin xyz="{_text(np.multiply(place, s))}" rpy="{_text(rpy)}"/>'
            f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" '
            f'effort="{self.build.effort * s**4:.6g}" velocity="20"/>{mimic}</joint>'
        )

    def fixed(self, name, parent, child, place=(0, 0, 0), rpy=(0, 0, 0)) -> None:
        """Add a joint that does not move."""
        place = np.multiply(place, self.build.scale)
        self.joints.append(
            f'<joint name="{name}" type="fixed"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{_text(place)}" rpy="{_text(rpy)}"/>'
            "</joint>"
        )


def urdf(build: Build | None = None, **options) -> str:
    """Return the URDF of a humanoid."""
    build = build or Build(**options)
    out = _Writer(build)
    base = out.link("base", 1.0)
    pelvis = out.link("pelvis", 8.0, size=(0.15, 0.3, 0.15))
    if build.chest_first:
        chest = _chest(out, "chest")
        out.fixed("root", base, chest, rpy=(0, 0, build.yaw))
        out.joint("waist_z", chest, pelvis, (0, 0, -0.2), _AXES["z"], "waist_z")
    else:
        out.fixed("root", base, pelvis, rpy=(0, 0, build.yaw))
        chest = _spine(out, pelvis)
    places = {0: [], 1: [("left", 0.0)], 2: [("left", 0.0), ("right", 0.0)]}
    places[4] = [*places[2], ("left_hind", -0.4), ("right_hind", -0.4)]
    for side, x in places[build.legs]:
        _leg(out, pelvis, side, x)
    for side in build.arms:
        _arm(out, chest, side)
    _extras(out, chest, pelvis)
    return _finished(out)


def _spine(out: _Writer, parent: str) -> str:
    """Add the waist and the chest."""
    for k, axis in enumerate(out.build.waist):
        last = k == len(out.build.waist) - 1
        child = _chest(out, "chest") if last else out.link(f"waist{k}", 0.5)
        out.joint(
            f"waist_{axis}",
            parent,
            child,
            (0, 0, 0.1),
            _AXES[axis],
            f"waist_{axis}",
        )
        parent = child
    if not out.build.waist:
        parent = _chest(out, "chest")
        out.fixed("spine", "pelvis", parent, (0, 0, 0.1))
    return parent


def _chest(out: _Writer, name: str) -> str:
    """Add the chest."""
    return out.link(name, 16.0, (0, 0, 0.15), (0.2, 0.3, 0.3))


def _leg(out: _Writer, parent: str, side: str, x: float) -> None:
    """Add a leg: the last link of each place is heavy, the others are specks."""
    y, previous = (0.1 if "left" in side else -0.1), ""
    for k, key in enumerate(out.build.leg):
        place, axis = key.split("_")
        offset = (x, y, -0.08) if k == 0 else (0.0, 0.0, 0.0)
        if k and place != previous:
            offset = (0.16 if place == "toe" else 0.0, 0.0, _DROPS[place])
            if place == "ankle" and side == "left":
                offset = (0.0, 0.0, offset[2] - out.build.uneven)
        last = k == len(out.build.leg) - 1
        same = not last and out.build.leg[k + 1].split("_")[0] == place
        foot = place == "ankle" and not same
        name = f"{side}_{key}"
        shape = _foot_shape(out.build) if foot else ""
        heavy = {"hip": 6.0, "knee": 3.5, "ankle": 1.2, "toe": 0.2}.get(place, 0.3)
        drop = -0.2 if place in ("hip", "knee") else -0.03
        size = (0.1, 0.1, 0.4) if place in ("hip", "knee") else (0.22, 0.1, 0.05)
        child = out.link(
            f"link_{name}", 0.3 if same else heavy, (0, 0, drop), size, shape
        )
        out.joint(name, parent, child, offset, _AXES[axis], key)
        parent, previous = child, place


def _foot_shape(build: Build) -> str:
    """Return the shape of a foot, its sole 0.08 m below the ankle."""
    size = _text(np.multiply((0.22, 0.11, 0.04), build.scale))
    place = _text(np.multiply((0.03, 0.0, -0.06), build.scale))
    shapes = {
        "box": f'<box size="{size}"/>',
        "mesh": '<mesh filename="package://nowhere/foot.stl"/>',
        "ball": f'<sphere radius="{0.05 * build.scale:.6g}"/>',
    }
    if build.foot == "none":
        return ""
    return (
        f'<collision><origin xyz="{place}"/><geometry>{shapes[build.foot]}'
        "</geometry></collision>"
    )


def _arm(out: _Writer, parent: str, side: str) -> None:
    """Add an arm and its hand."""
    sign = 1.0 if side == "left" else -1.0
    roll, pitch = _POSES[out.build.pose]
    previous = ""
    for k, key in enumerate(out.build.arm):
        place, axis = key.split("_")
        offset, rpy = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if k == 0:
            offset, rpy = (0.0, 0.2 * sign, 0.25), (sign * roll, pitch, 0.0)
        elif place != previous:
            offset = (0.0, 0.0, _DROPS[place])
        same = k + 1 < len(out.build.arm) and out.build.arm[k + 1].startswith(place)
        name = f"{side}_{key}"
        child = out.link(
            f"link_{name}",
            0.2 if same else 1.4,
            (0, 0, 0.0 if same else -0.1),
            (0.06, 0.06, 0.2),
        )
        out.joint(name, parent, child, offset, _AXES[axis], key, rpy)
        parent, previous = child, place
    for k in range(out.build.fingers):
        y = 0.03 * (k - 0.5 * (out.build.fingers - 1))
        first = out.link(f"{side}_finger{k}_1", 0.02, (0, 0, -0.02), (0.01,) * 3)
        tip = out.link(f"{side}_finger{k}_2", 0.01, (0, 0, -0.02), (0.01,) * 3)
        out.joint(f"{side}_f{k}_1", parent, first, (0, y, -0.12), _AXES["y"], "f")
        out.joint(f"{side}_f{k}_2", first, tip, (0, 0, -0.04), _AXES["y"], "f")


def _extras(out: _Writer, chest: str, pelvis: str) -> None:
    """Add head, tail and backpack."""
    parent = chest
    for k, axis in enumerate(out.build.neck):
        last = k == len(out.build.neck) - 1
        child = out.link(f"neck{k}", 3.0 if last else 0.2, (0, 0, 0.08))
        out.joint(f"neck_{axis}", parent, child, (0, 0, 0 if k else 0.32), _AXES[axis])
        parent = child
    if out.build.tail:
        first = out.link("tail_1", 0.4, (-0.1, 0, 0))
        tip = out.link("tail_2", 0.2, (-0.1, 0, 0))
        out.joint("tail_a", pelvis, first, (-0.1, 0, 0), _AXES["y"])
        out.joint("tail_b", first, tip, (-0.2, 0, 0), _AXES["y"])
    if out.build.backpack:
        out.joint(
            "strap", chest, out.link("backpack", 2.0), (-0.2, 0, 0.05), _AXES["y"]
        )


def _finished(out: _Writer) -> str:
    """Return the text, its names and the order of its joints random if asked."""
    links, joints = out.links, out.joints
    text = "\n".join([*links, *joints])
    if out.build.seed is not None:
        rng = random.Random(out.build.seed)
        rng.shuffle(joints)
        rng.shuffle(links)
        text = "\n".join([*links, *joints])
        for old, new in renaming(out.build).items():
            text = text.replace(f'"{old}"', f'"{new}"')
    return f'<robot name="toy">\n{text}\n</robot>\n'


def renaming(build: Build) -> dict[str, str]:
    """Return the random names of a build, by its usual ones."""
    out = urdf(Build(**{**vars(build), "seed": None}))
    names = {part.split('"')[1] for part in out.split("<link name=")[1:]}
    names |= {part.split('"')[1] for part in out.split("<joint name=")[1:]}
    rng = random.Random(build.seed)
    return {name: f"n{rng.getrandbits(64):x}" for name in sorted(names)}


def write(folder: Path, build: Build | None = None, **options) -> Path:
    """Write a humanoid into a folder, and return its file."""
    file = folder / "toy.urdf"
    file.write_text(urdf(build, **options), encoding="utf-8")
    return file


def _text(numbers) -> str:
    """Return numbers as an attribute."""
    return " ".join(f"{float(x):.9g}" for x in numbers)


def with_shape(text: str, link: str, shape: str) -> str:
    """Return a URDF with more in one of its links."""
    end = text.index("</link>", text.index(f'<link name="{link}"'))
    return text[:end] + shape + text[end:]
