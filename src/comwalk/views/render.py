"""Pictures of a run without a window: a still, a film strip, an animation.

On the floor: the footprints, and the paths of CoM (blue) and ZMP (orange) so far.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from PIL import Image

from ..embedding import yaw_of_quaternion
from ..errors import RunError, checked_number, one_line
from ..pattern import Phase, convex_hull
from ..runs import Source
from ..settings import check_settings, setting
from ..sides import Side
from .gl import no_opengl, open_context
from .scene_data import (
    highest_box,
    of_robot,
    scene_of,
    seen_of,
    sole_box,
    whole_state,
)
from .video import FILMS, check_film, mp4_writer


@dataclass(frozen=True, kw_only=True)
class View:
    """From where, how large and how finely a picture is taken."""

    width: int = setting(640, "Width", "pixel", "[16, 4096]")
    height: int = setting(480, "Height", "pixel", "[16, 4096]")
    azimuth: float = setting(
        math.radians(38.0),
        "Where the camera stands, seen from the robot's front, left positive",
        "rad",
        "(-inf, inf)",
    )
    elevation: float = setting(
        math.radians(18.0),
        "How far the camera stands above the horizon",
        "rad",
        "(-1.5708, 1.5708)",
    )
    distance: float = setting(
        1.75, "Distance of the camera, in heights of the robot", "", "[0.1, 100]"
    )
    shadows: bool = setting(
        False,
        "Whether the robot casts a shadow: nicer, and several times slower without a "
        "graphics card",
    )
    smooth: int = setting(
        1, "Pixels drawn for each one in the picture, along each side", "", "[1, 4]"
    )
    overlays: bool = setting(
        True, "Whether footprints and the paths of CoM and ZMP are drawn on the floor"
    )

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ParameterError: If a value is out of range.
        """
        check_settings(self)


class _Print(NamedTuple):
    """A sole on the floor."""

    landed: float  # [s]
    lifted: float  # [s]
    side: Side
    corners: np.ndarray  # [m], (4, 2), counter-clockwise
    center: np.ndarray  # [m], (3,)
    rotation: np.ndarray  # (3, 3)
    size: np.ndarray  # half lengths [m], (3,)


@dataclass(frozen=True, eq=False)
class _Recording:
    """The data of a picture."""

    model: mujoco.MjModel
    t: np.ndarray  # [s], (n,)
    qpos: np.ndarray  # (n, nq)
    com: np.ndarray  # [m], (n, 3)
    zmp: np.ndarray  # [m], (n, 2)
    prints: tuple[_Print, ...]
    center: np.ndarray  # what the camera looks at [m], (n, 2)
    ground: float = 0.0  # height that paths are drawn at [m]

    def row(self, time: float) -> int:
        """Return the row of a time."""
        return min(int(np.searchsorted(self.t, time)), len(self.t) - 1)


Film = Callable[[int], np.ndarray]
"""Takes a row of a recording, returns a picture of shape (height, width, 3)."""


def still(
    model: mujoco.MjModel,
    qpos: np.ndarray,
    path: str | Path | None = None,
    *,
    view: View | None = None,
) -> np.ndarray:
    """Take a picture of a robot in one posture.

    Args:
        model: A compiled scene, such as `build_scene` returns.
        qpos: MuJoCo's configuration, of shape (nq,), or the robot's part of it.
        path: Where to write the picture; not written if None.
        view: Camera and size; shadows and smooth edges if None.

    Returns:
        The picture, of shape (height, width, 3), uint8.

    Raises:
        RenderError: If this machine cannot draw.
        RunError: If the file cannot be written.
    """
    q = whole_state(model, qpos)[None]
    nothing = np.zeros((1, 3))
    recording = _Recording(model, np.zeros(1), q, nothing, nothing, (), q[:, :2])
    view = view or View(shadows=True, smooth=2, overlays=False)
    with _film(recording, view) as film:
        picture = film(0)
    _write([picture], path, fps=1.0)
    return picture


def render_still(
    source: Source,
    path: str | Path | None,
    time: float,
    *,
    view: View | None = None,
) -> np.ndarray:
    """Take a picture of a run at one time.

    Args:
        source: A run of a robot, or its folder.
        path: Where to write the picture; not written if None.
        time: When [s]; after the end, the last moment is taken.
        view: Camera and size.

    Returns:
        The picture, of shape (height, width, 3), uint8.

    Raises:
        RenderError: If this machine cannot draw.
        RunError: If there is no robot to draw or the file cannot be written.
    """
    recording = _recording(source)
    with _film(recording, view or View()) as film:
        picture = film(recording.row(checked_number("time", time, unit="s", low=0.0)))
    _write([picture], path, fps=1.0)
    return picture


def render_run(
    source: Source,
    path: str | Path,
    *,
    view: View | None = None,
    start: float = 0.0,
    stop: float | None = None,
    fps: float = 15.0,
    count: int = 5,
    quality: int = 70,
    progress: Callable[[float], None] | None = None,
) -> int:
    """Write a run as a film, or as a strip of stills side by side.

    Args:
        source: A run of a robot, or its folder.
        path: The file; .mp4, .webp and .gif are films, .png and .jpg strips of stills.
        view: Camera and size of each picture.
        start: When it starts [s].
        stop: When it ends [s]; None for the end of the run.
        fps: Pictures per second of a film.
        count: Pictures of a strip.
        quality: Quality of a film, 1 to 100; more makes a larger file.
        progress: Called with the share that is done, from 0 to 1.

    Returns:
        The number of pictures.

    Raises:
        RenderError: If this machine cannot draw.
        RunError: If there is no robot to draw or the file cannot be written.
        ParameterError: If a number is out of range.
    """
    recording = _recording(source)
    last = float(recording.t[-1])
    begin = checked_number("start", start, unit="s", low=0.0, high=last)
    end = last if stop is None else checked_number("stop", stop, unit="s", low=begin)
    end = min(end, last)
    checked_number("fps", fps, unit="1/s", low=0.1, high=100.0)
    n = int((end - begin) * fps) + 1
    if Path(path).suffix.lower() not in FILMS:
        n = int(checked_number("count", count, low=1, high=100))
    check_film(path)

    def pictures(film: Film) -> Iterator[np.ndarray]:
        """Yield the pictures at all times, and tell the progress."""
        for k, time in enumerate(np.linspace(begin, end, n).tolist()):
            yield film(recording.row(time))
            if progress is not None:
                progress((k + 1) / n)

    with _film(recording, view or View()) as film:
        _write(pictures(film), path, fps, quality)
    return n


def _write(
    pictures: Iterable[np.ndarray],
    path: str | Path | None,
    fps: float,
    quality: int = 80,
) -> None:
    """Write pictures as an animation, or side by side."""
    if path is None:
        return
    check_film(path)
    suffix = Path(path).suffix.lower()
    if suffix == ".mp4":
        with mp4_writer(path, fps, quality) as put:
            for picture in pictures:
                put(picture)
        return
    images = [Image.fromarray(p) for p in pictures]
    animated = suffix in FILMS and len(images) > 1
    options: dict[str, Any] = {"quality": quality}
    if animated:
        options |= {"save_all": True, "append_images": images[1:], "method": 4}
        options |= {"duration": round(1000.0 / fps), "loop": 0}
    else:
        images = [Image.fromarray(np.concatenate([np.asarray(i) for i in images], 1))]
    try:
        images[0].save(path, **options)
    except OSError as error:
        reason = error.strerror or error
        raise RunError(f"cannot write the picture {path}: {reason}") from None
    except ValueError as error:
        raise RunError(f"cannot write the picture {path}: {one_line(error)}") from None


# ---- What there is to see ---------------------------------------------------------


def _recording(source: Source) -> _Recording:
    """Return the data of pictures of a run or of its folder."""
    run = seen_of(source, geometry=True)
    model, columns = scene_of(run), run.columns
    return _Recording(
        model=model,
        t=run.t,
        qpos=columns["qpos"],
        com=run.com,
        zmp=columns["zmp_filtered"],
        prints=_footprints(model, columns["qpos"], run.t, columns["phase"]),
        center=run.center,
        ground=highest_box(model),
    )


def _footprints(
    model: mujoco.MjModel, qpos: np.ndarray, t: np.ndarray, phase: np.ndarray
) -> tuple[_Print, ...]:
    """Return the footprints, with their times."""
    data = mujoco.MjData(model)
    prints = []
    swings = {Side.LEFT: Phase.SINGLE_RIGHT, Side.RIGHT: Phase.SINGLE_LEFT}
    for side, swing in swings.items():
        down = np.concatenate([[False], phase != swing, [False]])
        edges = np.flatnonzero(down[1:] != down[:-1])
        for first, last in edges.reshape(-1, 2).tolist():
            data.qpos[:] = qpos[(first + last) // 2]
            mujoco.mj_kinematics(model, data)
            lifted = float(t[last]) if last < len(t) else math.inf
            box = sole_box(model, data, side)
            if box is not None:
                prints.append(_Print(float(t[first]), lifted, side, *box))
    return tuple(prints)


# ---- Drawing ----------------------------------------------------------------------


@contextmanager
def _film(recording: _Recording, view: View) -> Generator[Film]:
    """Open what draws the rows of a recording."""
    model = copy.copy(recording.model)
    width, height = view.smooth * int(view.width), view.smooth * int(view.height)
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    data, camera = mujoco.MjData(model), mujoco.MjvCamera()
    tall = _height(model, data, recording.qpos[0])
    azimuth = yaw_of_quaternion(recording.qpos[0, 3:7]) + view.azimuth
    camera.azimuth = math.degrees(azimuth) + 180.0
    camera.elevation = -math.degrees(view.elevation)
    camera.distance = view.distance * tall
    lamp = _light(model, azimuth, tall)
    option = mujoco.MjvOption()
    scene = mujoco.MjvScene(model, maxgeom=20000)

    def film(row: int) -> np.ndarray:
        """Return the picture of a row, the camera beside the robot."""
        camera.lookat[:] = *recording.center[row], 0.52 * tall
        model.light_pos[:] = camera.lookat + lamp
        data.qpos[:] = recording.qpos[row]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        mujoco.mjv_updateScene(
            model, data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene
        )
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = view.shadows
        if view.overlays:
            _draw_floor(scene, recording, row)
        return _shrunk(draw(scene), view.smooth)

    with _canvas(model, width, height) as draw:
        yield film


@contextmanager
def _canvas(
    model: mujoco.MjModel, width: int, height: int
) -> Generator[Callable[[mujoco.MjvScene], np.ndarray]]:
    """Open what turns a scene into a new picture.

    `mujoco.Renderer` would do so too, but only with the backend that was chosen before
    MuJoCo was imported.
    """
    with ExitStack() as opened:
        try:
            context = open_context(width, height)
            opened.callback(context.free)
            context.make_current()
            canvas = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
            opened.callback(canvas.free)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, canvas)
        except Exception as error:  # each backend has its own errors
            raise no_opengl(error) from None
        rect = mujoco.MjrRect(0, 0, width, height)

        def draw(scene: mujoco.MjvScene) -> np.ndarray:
            """Return the picture of a scene, (height, width, 3), its top row first."""
            picture = np.empty((height, width, 3), np.uint8)
            mujoco.mjr_render(rect, scene, canvas)
            mujoco.mjr_readPixels(picture, None, rect, canvas)
            return picture[::-1].copy()

        yield draw


def _light(model: mujoco.MjModel, azimuth: float, tall: float) -> np.ndarray:
    """Light a scene from beside the camera, and return the lamp's place [m].

    A far spot lamp that follows the robot has the sharpest shadows; the shadow map of
    a directional light is too coarse for a floor without end.
    """
    model.vis.quality.offsamples = 0
    model.vis.map.znear, model.vis.map.zfar = 0.05, 25.0
    model.vis.map.shadowscale = 0.1
    model.vis.rgba.haze[:] = (0.80, 0.84, 0.89, 1.0)
    angle = azimuth - math.radians(70.0)
    toward = np.array([0.54 * math.cos(angle), 0.54 * math.sin(angle), 1.0])
    toward /= np.linalg.norm(toward)
    model.light_type[:] = int(mujoco.mjtLightType.mjLIGHT_SPOT)
    model.light_dir[:], model.light_attenuation[:] = -toward, (1.0, 0.0, 0.0)
    model.light_cutoff[:], model.light_exponent[:] = 89.0, 0.0
    return 9.0 * tall * toward


def _shrunk(picture: np.ndarray, factor: int) -> np.ndarray:
    if factor == 1:
        return picture
    return np.asarray(Image.fromarray(picture).reduce(factor))


def _height(model: mujoco.MjModel, data: mujoco.MjData, qpos: np.ndarray) -> float:
    """Return the height of the standing robot [m]."""
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    own = of_robot(model)[model.geom_bodyid]
    return max(0.1, float(data.geom_xpos[own, 2].max()) + 0.08)


_COLORS = {
    Side.LEFT: (0.0, 0.45, 0.70),
    Side.RIGHT: (0.84, 0.37, 0.0),
}
_COM_COLOR, _ZMP_COLOR = (0.0, 0.35, 0.65, 1.0), (0.90, 0.36, 0.0, 1.0)
_HULL_COLOR = (0.1, 0.55, 0.3, 1.0)
_UPRIGHT = np.eye(3).ravel()


def _draw_floor(scene: mujoco.MjvScene, recording: _Recording, row: int) -> None:
    """Draw the footprints, the support polygon and the paths so far."""
    now = float(recording.t[row])
    up = recording.ground
    for mark in recording.prints:
        _draw_print(scene, mark, now, up)
    standing = [p.corners for p in recording.prints if p.landed <= now < p.lifted]
    if standing:
        hull = convex_hull(np.concatenate(standing))
        _draw_path(scene, np.vstack([hull, hull[:1]]), _HULL_COLOR, 0.003, up)
    step = max(1, round(0.04 / float(np.diff(recording.t[:2]).sum() or 0.04)))
    rows = np.append(np.arange(0, row, step), row)
    _draw_path(scene, recording.zmp[rows], _ZMP_COLOR, 0.0035, up)
    _draw_path(scene, recording.com[rows, :2], _COM_COLOR, 0.0045, up)


def _draw_print(scene: mujoco.MjvScene, mark: _Print, now: float, up: float) -> None:
    """Draw a footprint: filled where the foot stood, its outline where it will."""
    if mark.landed > now:
        outline = np.vstack([mark.corners, mark.corners[:1]])
        _draw_path(scene, outline, (*_COLORS[mark.side], 0.7), 0.0015, up)
        return
    size = np.array([mark.size[0], mark.size[1], 0.0006])
    bottom = max(0.0, mark.center[2] - mark.size[2])
    place = np.array([mark.center[0], mark.center[1], bottom + 0.0006])
    rgba = np.array([*_COLORS[mark.side], 0.4], np.float32)
    box, rotation = mujoco.mjtGeom.mjGEOM_BOX, mark.rotation.ravel()
    _add(scene, lambda g: mujoco.mjv_initGeom(g, box, size, place, rotation, rgba))


def _draw_path(
    scene: mujoco.MjvScene,
    points: np.ndarray,
    rgba: tuple[float, float, float, float],
    radius: float,
    up: float,
) -> None:
    """Draw a path at a height above the floor."""
    kind, color = mujoco.mjtGeom.mjGEOM_CAPSULE, np.array(rgba, np.float32)
    spots = np.column_stack([points, np.full(len(points), up + radius)])
    for a, b in pairwise(spots):
        if np.isfinite(a + b).all() and (np.abs(a - b) > 1e-4).any():
            geom = _add(
                scene,
                lambda g: mujoco.mjv_initGeom(
                    g, kind, np.zeros(3), np.zeros(3), _UPRIGHT, color
                ),
            )
            if geom is not None:
                mujoco.mjv_connector(geom, kind, radius, a, b)


def _add(
    scene: mujoco.MjvScene, fill: Callable[[mujoco.MjvGeom], None]
) -> mujoco.MjvGeom | None:
    """Add a geom to a scene while there is room."""
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    fill(geom)
    scene.ngeom += 1
    return geom
