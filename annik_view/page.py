"""The page in the browser: what :class:`annik_view.state.ViewState` has, drawn with viser."""

import html
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from annik_core.pose import FloatArray
from annik_core.solver.result import IkResult
from annik_view import shapes
from annik_view.server import LOCALHOST, PORT, PageServer, is_local, open_to_others
from annik_view.skeleton import Posture
from annik_view.state import PATHS, ViewState

#: Most changes that are drawn a second.
RATE = 60.0
#: All solutions are sought when the target has rested this long [s].
_REST = 0.15
#: Of the colours that the colour-blind can tell apart (Okabe and Ito).
_BLUE, _RED, _SKY, _ORANGE, _GREEN = (
    (0, 114, 178),
    (213, 94, 0),
    (86, 180, 233),
    (230, 159, 0),
    (0, 158, 115),
)
_LINK, _NOMINAL, _RANGE = (215, 219, 224), _ORANGE, (90, 90, 90)
#: Of examples: those to measure, and those that are measured.
_TO_DO, _DONE = _SKY, _GREEN
_MAGNIFICATIONS = ("1", "2", "5", "10", "20", "50", "100", "200", "500", "1000")
_NAME_STYLE = "opacity:.7;padding-right:.8em;white-space:nowrap"


@dataclass(eq=False)
class _Arm:
    """A robot in the scene, redrawn when it moves."""

    links: Any
    joints: Any
    reach: float

    @classmethod
    def added(
        cls,
        scene: Any,
        name: str,
        posture: Posture,
        reach: float,
        colours: tuple[Any, Any],
        **how: Any,
    ) -> "_Arm":
        parts = (shapes.links(posture, reach), shapes.joints(posture, reach))
        links, joints = (
            scene.add_mesh_simple(f"/{name}/{part}", *mesh, color=colour, **how)
            for part, mesh, colour in zip(("links", "joints"), parts, colours, strict=True)
        )
        return cls(links, joints, reach)

    def move(self, posture: Posture) -> None:
        self.links.vertices = shapes.links(posture, self.reach).vertices
        self.joints.vertices = shapes.joints(posture, self.reach).vertices


class Page:
    """A robot in the browser. All changes are made in one thread, :meth:`run`, the newest first.

    Attributes:
        drive: called with each target ``(7,)`` while the switch "drive" is on; None: no switch.
    """

    def __init__(
        self,
        state: ViewState,
        *,
        host: str = LOCALHOST,
        port: int = PORT,
        drive: Callable[[FloatArray], None] | None = None,
    ) -> None:
        self.state = state
        self.drive = drive
        self._lock = threading.Lock()
        self._changed = threading.Event()
        self._closed = threading.Event()
        self._requests: dict[str, Callable[[], None]] = {}
        self._drawn_solutions: list[IkResult] = []
        self._drawn_rows: frozenset[int] = frozenset()
        self.ghosts: list[Any] = []
        self._moved_at = time.monotonic()
        self.server = PageServer(host, port, own_page_only=drive is not None)
        self.host = host
        with self.server.atomic():
            self._build_scene()
            self._build_panel()
        self._draw()

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    @contextmanager
    def changing(self) -> Iterator[ViewState]:
        """The state, to be changed by another thread; it is drawn afterwards."""
        with self._lock:
            yield self.state
        self._changed.set()

    def run(self) -> None:
        """Draw what changes, until :meth:`close`."""
        try:
            while not self._closed.is_set():
                began = time.monotonic()
                playing = self._step()
                wait = 1.0 / RATE - (time.monotonic() - began)
                self._closed.wait(max(wait, 0.002))
                if not playing:
                    resting = time.monotonic() - self._moved_at < _REST
                    self._changed.wait(_REST if resting else 1.0)
        finally:
            self.server.stop()

    def close(self) -> None:
        """End :meth:`run`."""
        self._closed.set()
        self._changed.set()

    def request(self, name: str, change: Callable[[], None]) -> None:
        """Have a change made by :meth:`run`, in place of an older one of this name."""
        with self._lock:
            self._requests[name] = change
        self._changed.set()

    def _step(self) -> bool:
        """Make and draw the changes that were asked for; whether a path is being played."""
        with self._lock:
            changed = self._changed.is_set()
            self._changed.clear()
            requests, self._requests = self._requests, {}
            for change in requests.values():
                change()
            target = self.state.next_target()
            if target is not None:
                self._move_target(target)
                self.place_gizmo()
            rested = time.monotonic() - self._moved_at >= _REST
            if self._all.value and rested and not self.state.solutions and self.state.answer:
                self.state.find_solutions()
                changed = True
            if changed or target is not None:
                self._draw()
            return target is not None

    def _move_target(self, pose: FloatArray) -> None:
        self._moved_at = time.monotonic()
        self.state.move_target(pose)
        if self.drive is not None and self._drives.value:
            self.drive(pose)

    def _build_scene(self) -> None:
        scene, state, reach = self.server.scene, self.state, self.state.skeleton.reach
        scene.set_up_direction("+z")
        camera = self.server.initial_camera
        middle = 0.5 * (
            state.achieved[:3] + state.skeleton.posture(state.joint_positions).points[0]
        )
        camera.look_at = middle
        camera.position = middle + reach * np.array([0.6, -0.75, 0.35])
        scene.add_grid(
            "/ground",
            4.0 * reach,
            4.0 * reach,
            cell_size=0.1,
            section_size=0.5,
            shadow_opacity=0.2,
        )
        scene.add_frame("/base", axes_length=0.15 * reach, axes_radius=0.006 * reach)
        self._arm = _Arm.added(scene, "arm", state.posture(), reach, (_LINK, _BLUE))
        self._ranges = scene.add_line_segments(
            "/limits",
            state.skeleton.ranges(state.joint_positions),
            _RANGE,
            thickness=2.0,
            thickness_units="screen",
        )
        self._meshes = [
            scene.add_mesh_simple(f"/mesh/{number}", *one.mesh, color=_LINK)
            for number, one in enumerate(state.meshes)
        ]
        if self._meshes:
            self._arm.links.visible = self._arm.joints.visible = False
        nominal = state.magnified_nominal(state.suited_magnification)
        self._nominal = nominal and _Arm.added(
            scene, "nominal", nominal, reach, (_NOMINAL, _NOMINAL), opacity=0.6
        )
        self._end = scene.add_frame("/end", axes_length=0.12 * reach, axes_radius=0.006 * reach)
        self._gizmo = scene.add_transform_controls("/target", scale=0.22 * reach, depth_test=False)
        self._target = scene.add_icosphere("/target/at", 0.022 * reach, _BLUE, opacity=0.8)
        self._trails = [
            scene.add_line_segments(
                f"/trail/{name}",
                np.zeros((0, 2, 3)),
                colour,
                thickness=width,
                thickness_units="screen",
            )
            for name, colour, width in (("target", _ORANGE, 5.0), ("achieved", _GREEN, 2.5))
        ]
        if state.examples is not None:
            self._examples = scene.add_point_cloud(
                "/examples",
                state.examples.positions.astype(np.float32),
                self._example_colours(),
                point_size=0.02 * reach,
                point_shape="circle",
            )
        self.place_gizmo()
        self._gizmo.on_update(lambda event: self._dragged(event.target))

    def _build_panel(self) -> None:
        gui, state = self.server.gui, self.state
        gui.configure_theme(show_share_button=False, show_logo=False, control_width="medium")
        gui.add_markdown(
            f"**{html.escape(state.robot.name)}**: drag the target; click on a solution to take it"
        )
        if not is_local(self.host):
            gui.add_html(_coloured(_RED, html.escape(open_to_others(self.host))))
        self._readout = gui.add_html("")
        if self.drive is not None:
            self._drives = gui.add_checkbox("drive the robot", False)
            self._drives.on_update(lambda _: self._changed.set())
        self._all = gui.add_checkbox("all solutions", False)
        self._all.on_update(lambda _: self.request("solutions", self._forget_solutions))
        with gui.add_folder("joints [rad or m]", expand_by_default=False):
            self._sliders = list(self._joint_sliders())
        with gui.add_folder("path", expand_by_default=False):
            kind = gui.add_dropdown("path", tuple(PATHS))
            play, stop, clear = map(gui.add_button, ("play", "stop", "clear trails"))
            play.on_click(lambda _: self.request("path", lambda: state.start_path(kind.value)))
            stop.on_click(lambda _: self.request("path", state.stop_path))
            clear.on_click(lambda _: self.request("trails", state.clear_trails))
        if state.examples is not None and not state.follows:
            last = len(state.examples) - 1
            with gui.add_folder("examples"):
                row = gui.add_slider("row", min=0, max=last, step=1, initial_value=0)
                row.on_update(lambda _: self.request("joints", lambda: self._show_row(row.value)))
        if self._nominal is not None:
            with gui.add_folder("calibration"):
                self._magnification = gui.add_dropdown(
                    "difference times",
                    _MAGNIFICATIONS,
                    initial_value=f"{state.suited_magnification:.0f}",
                )
                self._magnification.on_update(lambda _: self._changed.set())

    def _joint_sliders(self) -> Iterable[Any]:
        state = self.state
        limits = state.robot.joint_limits
        bounds = zip(limits.lower.tolist(), limits.upper.tolist(), strict=True)
        for index, (lower, upper) in enumerate(bounds):
            # A continuous joint has no limits: its slider shows one turn either way.
            lower, upper = max(lower, -2.0 * np.pi), min(upper, 2.0 * np.pi)
            value = float(np.clip(state.joint_positions[index], lower, upper))
            slider = self.server.gui.add_slider(
                state.robot.joint_names[index],
                min=lower,
                max=upper,
                step=(upper - lower) / 1000.0,
                initial_value=value,
                disabled=state.follows or lower == upper,
            )
            slider.on_update(self._slid)
            yield slider

    def _slid(self, event: Any) -> None:
        if event.client is not None:  # not set by this program
            self.request("joints", self._take_sliders)

    def _take_sliders(self) -> None:
        self._moved_at = time.monotonic()
        self.state.show_joints([slider.value for slider in self._sliders])
        self.place_gizmo()

    def _show_row(self, row: int) -> None:
        self._moved_at = time.monotonic()
        self.state.show_example(row)
        self.place_gizmo()

    def _example_colours(self) -> NDArray[np.uint8]:
        examples = self.state.examples
        assert examples is not None
        rows = [_DONE if row in examples.measured else _TO_DO for row in range(len(examples))]
        return np.array(rows, dtype=np.uint8)

    def _dragged(self, gizmo: Any) -> None:
        # viser: w first; annik: w last.
        w, x, y, z = gizmo.wxyz
        pose = np.array([*gizmo.position, x, y, z, w])
        self.request("target", lambda: self._drag_to(pose))

    def _drag_to(self, pose: FloatArray) -> None:
        self.state.stop_path()
        self._move_target(pose)

    def _forget_solutions(self) -> None:
        self.state.solutions = []

    def _clicked(self, solution: IkResult, _: Any) -> None:
        self.request("choice", lambda: self._choose(solution))

    def _choose(self, solution: IkResult) -> None:
        for index, known in enumerate(self.state.solutions):
            if known is solution:
                self.state.choose(index)

    def place_gizmo(self) -> None:
        """Put the gizmo at the target, which something else than the gizmo has moved."""
        x, y, z, w = self.state.target[3:].tolist()
        self._gizmo.position, self._gizmo.wxyz = self.state.target[:3], (w, x, y, z)

    def _draw(self) -> None:
        """Bring the page up to date with the state."""
        state = self.state
        with self.server.atomic():
            posture = state.posture()
            self._arm.move(posture)
            self._ranges.points = state.skeleton.ranges(state.joint_positions).astype(np.float32)
            colour = _RED if state.refused else _BLUE
            self._arm.joints.color = self._target.color = colour
            self._draw_meshes()
            if self._nominal is not None:
                nominal = state.magnified_nominal(float(self._magnification.value))
                assert nominal is not None
                self._nominal.move(nominal)
            x, y, z, w = state.achieved[3:].tolist()
            self._end.position, self._end.wxyz = state.achieved[:3], (w, x, y, z)
            for line, trail in zip(
                self._trails, (state.target_trail, state.achieved_trail), strict=True
            ):
                points = np.array(trail, dtype=np.float32).reshape(-1, 3)
                line.points = np.stack([points[:-1], points[1:]], axis=1)
            for slider, value in zip(self._sliders, state.joint_positions.tolist(), strict=True):
                slider.value = float(np.clip(value, slider.min, slider.max))
            if state.examples is not None and state.examples.measured != self._drawn_rows:
                self._drawn_rows = state.examples.measured
                self._examples.colors = self._example_colours()
            self._readout.content = _table(state, drives=self._driving())
            self._draw_solutions()

    def _draw_meshes(self) -> None:
        for mesh, pose in zip(self._meshes, self.state.mesh_poses(), strict=True):
            mesh.visible = pose is not None
            mesh.color = _RED if self.state.refused else _LINK
            if pose is not None:
                x, y, z, w = pose[3:]
                mesh.position, mesh.wxyz = np.array(pose[:3]), (w, x, y, z)

    def _draw_solutions(self) -> None:
        solutions = self.state.solutions
        if len(solutions) == len(self._drawn_solutions) and all(
            one is other for one, other in zip(solutions, self._drawn_solutions, strict=True)
        ):
            return
        for ghost in self.ghosts:
            ghost.remove()
        self.ghosts, self._drawn_solutions = [], list(solutions)
        reach = self.state.skeleton.reach
        for index, solution in enumerate(solutions):
            assert solution.joint_positions is not None
            mesh = shapes.whole(self.state.skeleton.posture(solution.joint_positions), reach)
            ghost = self.server.scene.add_mesh_simple(
                f"/solutions/{index}", *mesh, color=_SKY, opacity=0.3, cast_shadow=False
            )
            ghost.on_click(partial(self._clicked, solution))
            self.ghosts.append(ghost)

    def _driving(self) -> bool:
        return self.drive is not None and bool(self._drives.value)


def _table(state: ViewState, *, drives: bool) -> str:
    rows = "".join(
        f"<tr><td style='{_NAME_STYLE}'>{html.escape(name)}</td>"
        f"<td id='{name.split()[0]}'>{html.escape(value)}</td></tr>"
        for name, value in state.readout()
    )
    words = "the target moves the robot" if drives else ""
    head = _coloured(_RED, words) if words else ""
    colour = _RED if state.refused else _BLUE
    style = f"border-left:4px solid rgb{colour};padding:.2em .8em;margin:.3em 1em;font-size:.85em"
    return f"<div style='{style}' class='annik-readout'>{head}<table>{rows}</table></div>"


def _coloured(colour: tuple[int, int, int], text: str) -> str:
    return f"<div style='color:rgb{colour};font-weight:600;padding:.2em 1em'>{text}</div>"
