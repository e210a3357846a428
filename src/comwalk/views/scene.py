"""A robot in a browser's 3D scene, with what the controller sees drawn around it.

`Stage` builds the scene on a viser server and shows one `Moment` after the other: live,
from a record, or into one page that plays by itself (`scene_page`).

Everything hangs below one node that moves against the walk, so that the robot stays
where the camera looks, and nothing drifts apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from ..control import Contact, zmp_from_wrenches
from ..embedding import yaw_of_quaternion
from ..errors import checked_number
from ..pattern import FootstepPlan, Phase, convex_hull, foot_poses, rectangle
from ..runs import Landing, Moment, RunData, moved_steps
from ..sides import Side
from ..walking import FLOOR
from .geoms import shapes_of
from .page_server import open_server
from .scene_data import highest_box, scene_of, sole_box, whole_state

if TYPE_CHECKING:
    import viser
    from viser.infra import StateSerializer

Color = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

COLORS: dict[str, Color] = {
    "CoM": (0, 90, 166),
    "CoM reference": (120, 175, 225),
    "ZMP": (230, 92, 0),
    "ZMP reference": (122, 51, 0),
    "support polygon": (26, 140, 77),
    "wrenches": (176, 0, 90),
    "left footsteps": (0, 115, 178),
    "right footsteps": (214, 94, 0),
    "moved footsteps": (176, 0, 90),
}
"""What is drawn around the robot, and in which colour."""


SEEN_THROUGH = 0.6
"""How opaque a robot is, so that its CoM is seen in it."""

_SWINGING = {Phase.SINGLE_LEFT: Side.RIGHT, Phase.SINGLE_RIGHT: Side.LEFT}
_TRANSFORM = 2.0**14  # steps per m, or per unit of a quaternion: few bytes in a page
_PLACE = 2.0**11  # steps per m of what is drawn around the robot
_LENGTHS = 64.0  # lengths of an arrow that are told apart, per weight of the robot
_LIFT = 0.003  # height of lines above the floor [m]


class Stage:
    """The scene of one model on a viser server. Final."""

    def __init__(
        self,
        server: viser.ViserServer,
        model: mujoco.MjModel,
        qpos: np.ndarray,
        plan: FootstepPlan | None = None,
        *,
        opacity: float = 1.0,
    ) -> None:
        """Build the scene.

        Args:
            server: Where to build it; what was there stays.
            model: A compiled scene with a robot, such as `build_scene` returns.
            qpos: Where the robot stands at first, as `whole_state` takes it.
            plan: Footsteps to draw on the floor.
            opacity: How opaque the robot is, in (0, 1]; less lets the CoM be seen.
        """
        self.server = server
        self._api: Any = server.scene
        self._model, self._data = model, mujoco.MjData(model)
        self._ground = highest_box(model)
        self._sensors = [_ankle_site(model, side) for side in Side]
        base = int(model.jnt_bodyid[0])
        self._weight = float(model.body_subtreemass[base])
        self._weight *= float(np.linalg.norm(model.opt.gravity))
        self._data.qpos[:] = whole_state(model, qpos)
        mujoco.mj_kinematics(model, self._data)
        mujoco.mj_comPos(model, self._data)
        self.height = max(0.1, float(self._data.subtree_com[base, 2]))
        self._root = self._api.add_frame("/walk", show_axes=False)
        self._bodies = self._add_robot(opacity)
        self._poses = np.zeros((model.nbody, 7))
        self.layers: dict[str, Any] = {}
        """What can be hidden, by name: the nodes that hold it."""
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, FLOOR) >= 0:
            self._add_floor(qpos)
        self._add_marks()
        if plan is not None:
            self.draw_plan(plan)
        self._aim(qpos)

    def show(
        self,
        moment: Moment,
        center: np.ndarray,
        com_path: np.ndarray,
        zmp_path: np.ndarray,
    ) -> None:
        """Show one moment; what did not change is not sent.

        Args:
            moment: What there is to see.
            center: What the camera looks at, on the ground [m], of shape (2,).
            com_path: Where the CoM was lately [m], of shape (n, 2) or (n, 3).
            zmp_path: Where the ZMP was [m], of shape (n, 2).
        """
        self._data.qpos[:] = moment.qpos
        mujoco.mj_kinematics(self._model, self._data)
        with self.server.atomic():
            x, y = center.tolist()
            self._root.position = _coarse(np.array([-x, -y, 0.0]), _TRANSFORM)
            self._move_bodies()
            self._move_marks(moment)
            self._draw_polygon(moment.phase)
            self._draw_wrenches(moment.wrenches)
            self._com_path.points = _chain(com_path, self._ground + _LIFT)
            self._zmp_path.points = _chain(zmp_path, self._ground + 2 * _LIFT)

    def opaque(self, opacity: float) -> None:
        """Make the robot more or less opaque.

        Args:
            opacity: In (0, 1].
        """
        for mesh, own in self._meshes:
            value = own * opacity
            mesh.opacity = value if value < 1.0 else None

    # ---- The robot ----------------------------------------------------------------

    def _add_robot(self, opacity: float) -> dict[int, Any]:
        """Add the bodies that are seen, each below its parent; return their nodes."""
        model, shapes = self._model, shapes_of(self._model)
        seen = {0}
        for shape in shapes:
            body = shape.body
            while body not in seen:
                seen.add(body)
                body = int(model.body_parentid[body])
        nodes: dict[int, Any] = {}
        self._meshes: list[tuple[Any, float]] = []
        self._api.add_frame("/walk/robot", show_axes=False)
        names = {0: "/walk/robot"}
        for body in sorted(seen - {0}):
            names[body] = f"{names[int(model.body_parentid[body])]}/{body}"
            nodes[body] = self._api.add_frame(names[body], show_axes=False)
        for k, shape in enumerate(shapes):
            mesh = self._api.add_mesh_simple(
                f"{names[shape.body]}/m{k}",
                shape.vertices,
                shape.faces,
                color=shape.color,
            )
            self._meshes.append((mesh, shape.opacity))
        self.opaque(opacity)
        return nodes

    def _move_bodies(self) -> None:
        """Move each body relative to its parent, if it moved there."""
        data, parents = self._data, self._model.body_parentid
        poses, turn = np.zeros_like(self._poses), np.empty(4)
        for body in self._bodies:
            parent = parents[body]
            mujoco.mju_negQuat(turn, data.xquat[parent])
            mujoco.mju_mulQuat(poses[body, 3:], turn, data.xquat[body])
            arm = data.xpos[body] - data.xpos[parent]
            mujoco.mju_rotVecQuat(poses[body, :3], arm, turn)
        poses = _coarse(poses, _TRANSFORM)
        for body, node in self._bodies.items():
            old, new = self._poses[body], poses[body]
            if (new[:3] != old[:3]).any():
                node.position = new[:3]
            if (new[3:] != old[3:]).any():
                node.wxyz = new[3:]
        self._poses = poses

    # ---- Around the robot ---------------------------------------------------------

    def _add_floor(self, qpos: np.ndarray) -> None:
        """Add the floor, without end."""
        self._api.add_grid(
            "/walk/floor",
            infinite_grid=True,
            cell_size=0.1,
            section_size=0.5,
            cell_thickness=0.6,
            section_thickness=1.0,
            cell_color=(226, 229, 233),
            section_color=(196, 201, 208),
            fade_distance=14.0,
            fade_strength=1.5,
            shadow_opacity=0.18,
            position=(float(qpos[0]), float(qpos[1]), 0.0),
        )

    def _add_marks(self) -> None:
        """Add CoM, ZMP, their references and paths, support polygon and wrenches."""
        size, api = 0.035 * self.height, self._api
        for name in ("CoM", "ZMP", "support polygon", "wrenches", "footsteps"):
            where = f"/walk/{name.split()[0].lower()}"
            self.layers[name] = api.add_frame(where, show_axes=False)
        balls = (
            ("com/actual", "CoM", size),
            ("com/reference", "CoM reference", 0.7 * size),
            ("zmp/actual", "ZMP", 0.6 * size),
            ("zmp/reference", "ZMP reference", 0.45 * size),
        )
        self._balls = {
            name: api.add_icosphere(
                f"/walk/{name}", radius=radius, color=COLORS[color], cast_shadow=False
            )
            for name, color, radius in balls
        }
        self._balls["com/ground"] = api.add_cylinder(
            "/walk/com/ground",
            radius=0.7 * size,
            height=0.002,
            color=COLORS["CoM"],
            cast_shadow=False,
        )
        plumb = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, -self.height]]])
        color, thin = COLORS["CoM"], 0.12 * size
        api.add_line_segments("/walk/com/actual/plumb", plumb, color, thickness=thin)
        self._com_path = self._add_lines("com/path", "CoM", 0.25 * size)
        self._zmp_path = self._add_lines("zmp/path", "ZMP", 0.2 * size)
        self._polygon = self._add_lines(
            "support/polygon", "support polygon", 0.2 * size
        )
        self._arrows = [self._add_arrow(side, size) for side in Side]

    def _add_arrow(self, side: Side, size: float) -> tuple[Any, Any]:
        """Add an upright arrow for the whole weight; return its foot and itself."""
        where, tip = f"/walk/wrenches/{side}", [0.0, 0.0, 0.9 * self.height]
        foot = self._api.add_frame(where, show_axes=False, visible=False)
        arrow = self._api.add_arrows(
            f"{where}/arrow",
            np.array([[np.zeros(3), tip]]),
            COLORS["wrenches"],
            shaft_radius=0.25 * size,
            head_radius=0.6 * size,
            head_length=1.5 * size,
        )
        return foot, arrow

    def _add_lines(self, name: str, color: str, thickness: float) -> Any:
        """Add lines in one colour, without any line yet."""
        return self._api.add_line_segments(
            f"/walk/{name}", np.zeros((1, 2, 3)), COLORS[color], thickness=thickness
        )

    def draw_plan(self, plan: FootstepPlan) -> None:
        """Draw the outlines of all footsteps of a plan, in place of another's.

        Args:
            plan: The plan.
        """
        poses = foot_poses(plan)
        for k, side in enumerate(Side):
            places = np.unique(poses[:, k].round(6), axis=0)
            self._draw_soles(f"{side}", places, plan.sole_size)
        self.draw_moved((), plan)

    def draw_moved(self, moved: Sequence[Landing], plan: FootstepPlan) -> None:
        """Draw the outlines of footsteps that landed elsewhere than planned.

        Args:
            moved: The feet and where they landed, `runs.moved_steps`.
            plan: What was planned.
        """
        places = [(place.x, place.y, place.yaw) for _, place in moved]
        self._draw_soles("moved", np.array(places).reshape(-1, 3), plan.sole_size)

    def _draw_soles(
        self, kind: str, places: np.ndarray, size: tuple[float, float]
    ) -> None:
        """Draw outlines of soles, in place of those of the same kind."""
        outlines = [rectangle(x, y, yaw, size) for x, y, yaw in places.tolist()]
        z = self._ground + (0.75 if kind == "moved" else 0.5) * _LIFT
        lines = [_chain(np.vstack([o, o[:1]]), z) for o in outlines]
        self._api.add_line_segments(
            f"/walk/footsteps/{kind}",
            np.concatenate([np.zeros((1, 2, 3)), *lines]),
            COLORS[f"{kind} footsteps"],
            thickness=0.005 * self.height,
        )

    def _aim(self, qpos: np.ndarray) -> None:
        """Point the camera at the robot from its front left."""
        angle = yaw_of_quaternion(qpos[3:7]) + math.radians(38.0)
        away, up = 3.3 * self.height, 1.9 * self.height
        camera = self.server.initial_camera
        camera.position = (away * math.cos(angle), away * math.sin(angle), up)
        camera.look_at = (0.0, 0.0, 1.05 * self.height)
        camera.fov = math.radians(45.0)

    def _move_marks(self, moment: Moment) -> None:
        """Move CoM and ZMP and their references."""
        z = self._ground + _LIFT
        places = {
            "com/actual": moment.com,
            "com/reference": moment.com_ref,
            "com/ground": (*moment.com[:2], z),
            "zmp/actual": (*moment.zmp, z),
            "zmp/reference": (*moment.zmp_ref, z),
        }
        for name, place in places.items():
            if np.isfinite(place).all():
                self._balls[name].position = _coarse(np.array(place), _PLACE)

    def _draw_polygon(self, phase: Phase) -> None:
        """Draw the hull of the soles that are to carry."""
        soles = [side for side in Side if _SWINGING.get(phase) is not side]
        boxes = [sole_box(self._model, self._data, side) for side in soles]
        corners = [box.corners for box in boxes if box is not None]
        if corners:
            hull = _coarse(convex_hull(np.concatenate(corners)), 2.0**9)
            closed = np.vstack([hull, hull[:1]])
            self._polygon.points = _chain(closed, self._ground + _LIFT)

    def _draw_wrenches(self, wrenches: np.ndarray) -> None:
        """Draw the force on each foot, from the point where the ground pushes."""
        for k, site in enumerate(self._sensors):
            if site is None:
                continue
            r, R = self._data.site_xpos[site], self._data.site_xmat[site].reshape(3, 3)
            f, m = R @ wrenches[k, :3], R @ wrenches[k, 3:]
            contact = Contact(tuple(r.tolist()), f.tolist(), m.tolist())
            point = zmp_from_wrenches([contact], least_load=0.03 * self._weight)
            foot, arrow = self._arrows[k]
            foot.visible = point is not None
            if point is not None:
                foot.position = _coarse(np.array([*point, self._ground]), _PLACE)
                size = float(np.linalg.norm(f))
                x, y, z = (f / size).tolist()  # the shortest turn of z to there
                turn = np.array([1.0 + z, -y, x, 0.0])
                foot.wxyz = _coarse(turn / np.linalg.norm(turn), _TRANSFORM)
                length = round(_LENGTHS * size / self._weight) / _LENGTHS
                arrow.scale = (1.0, 1.0, max(length, 1.0 / _LENGTHS))


def _coarse(values: np.ndarray, steps: float) -> np.ndarray:
    return np.round(np.asarray(values) * steps) / steps


def _chain(points: np.ndarray, height: float) -> np.ndarray:
    if len(points) < 2:
        return np.zeros((1, 2, 3))
    spots = np.column_stack([points[:, :2], np.full(len(points), height)])
    return _coarse(np.stack([spots[:-1], spots[1:]], axis=1), _PLACE)


def _ankle_site(model: mujoco.MjModel, side: Side) -> int | None:
    name = f"{side.value[0]}_force"
    sensor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, name)
    return None if sensor < 0 else int(model.sensor_objid[sensor])


# ---- Records ----------------------------------------------------------------------

_TRAIL = 6.0  # time that paths show [s]
_TRAIL_POINTS = 25.0  # points of a path per second [1/s]


def show_row(stage: Stage, run: RunData, row: int, follow: bool = True) -> None:
    """Show one row of a record.

    Args:
        stage: The scene.
        run: The record.
        row: Which row.
        follow: Whether the robot stays where the camera looks.
    """
    t = run.t
    step = max(1, round(1.0 / (_TRAIL_POINTS * float(np.diff(t[:2]).sum() or 1.0))))
    # Each point of a path is a row that stays the same from one picture to the next.
    first = -(-int(np.searchsorted(t, t[row] - _TRAIL)) // step) * step
    rows = np.append(np.arange(first, row, step), row)
    center = run.center[row if follow else 0]
    paths = run.com[rows], run.columns["zmp_filtered"][rows]
    stage.show(run.moment(row), center, *paths)


def scene_page(
    run: RunData,
    *,
    fps: float = 30.0,
    opacity: float = SEEN_THROUGH,
    progress: Callable[[float], None] | None = None,
) -> str:
    """Return a page that plays a record by itself, without any network.

    Args:
        run: The record.
        fps: Pictures per second, in [1, 60].
        opacity: How opaque the robot is, in (0, 1].
        progress: Called with the share that is done, from 0 to 1.

    Returns:
        HTML with all that it needs.

    Raises:
        ParameterError: If a number is out of range.
    """
    return _filmed(run, fps, opacity, progress).as_html()


def scene_film(
    run: RunData,
    *,
    fps: float = 30.0,
    opacity: float = SEEN_THROUGH,
    progress: Callable[[float], None] | None = None,
) -> bytes:
    """Return a recorded scene in viser's own format, for pages of one's own.

    Args:
        run: The record.
        fps: Pictures per second, in [1, 60].
        opacity: How opaque the robot is, in (0, 1].
        progress: Called with the share that is done, from 0 to 1.

    Returns:
        The film; a page holds it in base64 as `window.__VISER_EMBED_DATA__`.

    Raises:
        ParameterError: If a number is out of range.
    """
    return _filmed(run, fps, opacity, progress).serialize()


def _filmed(
    run: RunData,
    fps: float,
    opacity: float,
    progress: Callable[[float], None] | None,
) -> StateSerializer:
    """Return all pictures of a record."""
    checked_number("fps", fps, unit="1/s", low=1.0, high=60.0)
    checked_number("opacity", opacity, low=0.0, high=1.0, open_low=True)
    rows = run.rows(fps).tolist()
    with open_server() as server:
        qpos = run.columns["qpos"][0]
        stage = Stage(server, scene_of(run), qpos, run.plan, opacity=opacity)
        if run.plan is not None:
            stage.draw_moved(moved_steps(run.columns, run.plan), run.plan)
        show_row(stage, run, 0)
        film = server.get_scene_serializer()
        for k, row in enumerate(rows):
            show_row(stage, run, row)
            film.insert_sleep(1.0 / fps)
            if progress is not None and k % 10 == 0:
                progress((k + 1) / len(rows))
    return film
