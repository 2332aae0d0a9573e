"""A session in a notebook: live pictures, a camera that the mouse moves, and a choice of layer and exposure.

Widget and browser share a few traits, by the protocol of Jupyter's widgets. The browser sets `layer`, `exposure` and
`gesture`, the widget all others; widget.js is the browser's side.
"""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from ..runtime.files import PathLike
from ..scene import Array, SceneError
from ..usd.stage import up_axis
from .encoding import encoded
from .navigation import moved, orbited, pivot_distance
from .session import Picture, Problem, Session

try:
    import anywidget
    from traitlets import Dict, Float, List, Unicode, observe
except ImportError:
    raise ImportError("the widget needs anywidget: expected `pip install 'photonbeams[notebook]'`") from None

# Pixels along the longer side of a session that the widget opens.
_LONGEST = 480
# Seconds between pictures that differ only in their number of passes: notebooks do not say when they lag behind.
_PAUSE = 0.1
_CLOSEST = 1e-3  # scene units: the least distance from the camera to the point that it orbits
_STILL = [0.0] * 6


class Widget(anywidget.AnyWidget):
    r"""A live session in a notebook. Dragging the picture orbits, with Shift it pans; the wheel dollies.

    Parameters
    ----------
    session
        A session, which stays open when the widget is closed; or a USD file, for which the widget opens a session.
    **given
        For a USD file: further arguments of `Session`. Without a `view`, the picture has the camera's aspect.

    Attributes
    ----------
    session
        The session: `session.edit(...)` and `session.show(...)` change the picture.
    layer, exposure
        The layer that is shown, and its exposure in stops, from −64 to 64; both may be set.
    layers
        The names of the layers that can be shown.
    problem
        A sentence that says why there is no picture; empty if there is one.
    picture
        What the browser shows: "data" are the bytes of a PNG or a JPEG ("mime"), of "width" times "height" pixels,
        with "passes" of "planned" passes; "whole" is the size of the finished picture. Empty: nothing yet.
    gesture
        All movements of the camera in the browser, as sums: how often it went back to its place on the stage; since
        then, turns to the left and up in radians, movements to the right and up in widths of the picture, and nearer in
        logarithms of the distance.

    Raises
    ------
    SceneError
        A file that cannot be read as a stage; arguments of `Session` together with a session.

    Examples
    --------
    >>> widget = pb.studio.widget.Widget("shot.usda")  # a notebook shows it at the end of a cell
    >>> widget.layer, widget.exposure = "beams", 1.5
    >>> widget.session.view.width
    480
    >>> widget.close()
    """

    _esm = Path(__file__).with_name("widget.js")
    _css = Path(__file__).with_name("widget.css")

    layer = Unicode("rgba").tag(sync=True)
    exposure = Float(0.0, min=-64.0, max=64.0).tag(sync=True)
    gesture = List(Float(), _STILL, minlen=len(_STILL), maxlen=len(_STILL)).tag(sync=True)
    layers = List(Unicode(), ["rgba"]).tag(sync=True)
    picture = Dict().tag(sync=True)
    problem = Unicode().tag(sync=True)

    session: Session
    _own: Session | None = None  # the session that the widget opened, and closes
    _end: Any = None  # a function that stops listening to the session
    _last: Picture | None = None
    _sent = 0.0  # when the last picture was sent
    _distance: float | None = None  # from the camera to the point that it orbits; None: not guessed yet

    def __init__(self, session: Session | PathLike, **given: Any) -> None:
        if isinstance(session, Session):
            if given:
                raise SceneError(f"{', '.join(given)}: expected only with the path of a stage, not with a session")
            self.session = session
        else:
            self.session = self._own = _opened(session, given)
        # The session's thread sets traits, too: see `set_state`.
        self._lock = threading.RLock()
        super().__init__()
        self._end = self.session.listen(self._told)
        self.session.show()  # for a picture: the last one may have come before the widget listened

    def close(self) -> None:
        """Remove the widget from the notebook, and close the session that it opened."""
        if self._end is not None:
            self._end()
            self._end = None
        if self._own is not None:
            self._own.close()
            self._own = None
        super().close()

    def set_state(self, sync_data: dict[str, Any]) -> None:
        """Take traits from the browser; meanwhile traitlets holds back all changes, also those of other threads."""
        with self._lock:
            super().set_state(sync_data)

    def _told(self, what: Picture | Problem) -> None:
        """Show what the session tells; this runs in the session's thread."""
        with self._lock:
            if isinstance(what, Problem):
                self.problem = what.text
                return
            self.problem, self._last = "", what
            self.layers = list(what.layers)
            is_next = not what.is_first and 1 < what.passes < what.planned
            if not is_next or time.monotonic() - self._sent > _PAUSE:
                self._show()

    @observe("layer", "exposure")
    def _shown_otherwise(self, _change: Any) -> None:
        with self._lock:
            self._show()

    def _show(self) -> None:
        """Send the last picture to the browser."""
        last = self._last
        if last is None:
            return
        found, data = encoded(last, self.layer, self.exposure)
        whole = [round(each / last.scale) for each in (found.width, found.height)]
        self.picture = {
            "data": data, "mime": found.mime, "width": found.width, "height": found.height, "whole": whole,
            "passes": 0 if last.is_first else last.passes, "planned": last.planned,
        }  # fmt: skip
        self._sent = time.monotonic()

    @observe("gesture")
    def _gestured(self, change: Any) -> None:
        """Move the camera by the difference between this gesture and the last one."""
        (homes, *now), (earlier, *before) = change["new"], change["old"]
        at_home = homes != earlier
        if at_home:
            before, self._distance = _STILL[1:], None
        more = [one - other for one, other in zip(now, before, strict=True)]
        try:
            self.session.show(pose=self._moved(at_home, *more) if any(more) else None)
        except SceneError as error:
            self.problem = str(error)

    def _moved(self, at_home: bool, yaw: float, pitch: float, right: float, up: float, nearer: float) -> Array:
        """Return the pose of the camera after a movement from where it is or, `at_home`, where the stage has it."""
        camera, pose = self.session.camera(), self.session.view.pose
        if at_home or pose is None:
            pose = camera.to_world
        distance = pivot_distance(pose) if self._distance is None else self._distance
        self._distance = max(distance * float(np.exp(-np.clip(nearer, -20, 20))), _CLOSEST)
        pose = orbited(pose, up_axis(self.session.shot.stage), distance, yaw, pitch)
        width = camera.horizontal_aperture * (1.0 if camera.orthographic else distance / camera.focal_length)
        return moved(pose, right * width, up * width, distance - self._distance)


def _opened(path: PathLike, given: dict[str, Any]) -> Session:
    """Return a session of a stage; without a view it has the camera's aspect."""
    session = Session(path, **given)
    try:
        if "view" not in given:
            width, height = session.shot.resolution()
            scale = _LONGEST / max(width, height)
            session.show(width=max(1, round(scale * width)), height=max(1, round(scale * height)))
    except SceneError:
        session.close()
        raise
    return session
