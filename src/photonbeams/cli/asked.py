"""The request of `photonbeams render`: all its flags, for stages and for Mitsuba scenes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from .flags import Device, FogFlags, PassRange, Quality, SelectionFlags, start_device
from .outputs import Output, PictureExposure
from .progress import Progress

if TYPE_CHECKING:
    from ..farm.cluster import FarmOptions
    from ..images.plates import Holdout, Plate
    from ..usd.cameras.stereo import Stereo
    from ..usd.settings import RenderProduct


@dataclass(frozen=True, kw_only=True)
class Plates:
    """Pictures of another renderer: its depth, at which beams end, and a plate that they are added to."""

    holdout: str | None
    channel: str | None
    depth: str
    scale: float
    over: str | None
    fog: bool

    def end(self) -> Holdout | None:
        """Return the holdout, if there is one."""
        from ..images.plates import Holdout

        return Holdout(self.holdout, self.channel, self.depth, self.scale) if self.holdout else None

    def plate(self) -> Plate | None:
        """Return the plate, if there is one."""
        from ..images.plates import Plate

        return Plate(self.over, self.fog) if self.over else None


@dataclass(frozen=True, kw_only=True)
class Asked:
    """The flags of a render; None where they leave the choice to the scene."""

    path: Path
    outputs: Sequence[Output]
    layers: str | None
    exposure: PictureExposure
    frames: str | None
    skip_existing: bool
    checkpoint: float | None
    resume: bool
    snapshot: float | None
    part: PassRange | None
    farm: FarmOptions | None
    quality: Quality
    camera: str | None
    list_cameras: bool
    res: tuple[int, int]
    res_scale: float
    crop: tuple[float, float, float, float] | None
    tile: tuple[int, int] | None
    render_settings: str | None
    render_pass: str | None
    allow_paths: bool
    overrides: Sequence[str]
    session_layers: Sequence[Path]
    texture_limit: int | None
    selection: SelectionFlags
    fog: FogFlags
    dome_beams: bool
    strict: bool
    looks: Sequence[str]
    groups: Sequence[str]
    simulate: str | None
    emit: str | None
    stereo: Stereo | None
    view: str | None
    plates: Plates
    device: Device
    threads: int | None
    progress: Progress | None
    dry_run: bool
    quiet: bool
    verbose: bool
    command: str

    def wants(self, layer: str, products: Iterable[RenderProduct] = ()) -> bool:
        """Return whether the flags ask for a layer or, if they name no files, the render products do."""
        given = self.layers.split(",") if self.layers is not None else []
        asked = () if self.outputs else (each.variables for each in products)
        return layer in {name.strip() for name in given} | {name for each in asked for name in each}

    def crop_of(self, width: int, height: int, own: Sequence[float] | None = None) -> Sequence[float] | None:
        """Return the part of the picture to render, in fractions: that of the flags or else the scene's `own`."""
        from ..images.frame import tile_of

        crop = self.crop or own
        return crop if self.tile is None else tile_of(crop, width, height, self.tile)

    def anywhere(self) -> Asked:
        """Return the request with absolute paths, for a process that runs in another folder."""

        def absolute(text: str | None) -> str | None:
            """Return FILE or PRIM=FILE.py:NAME with an absolute path."""
            if text is None:
                return None
            prim, equals, file = text.rpartition("=")
            return f"{prim}{equals}{Path(file).absolute()}"

        plates = replace(self.plates, holdout=absolute(self.plates.holdout), over=absolute(self.plates.over))
        return replace(
            self, path=self.path.absolute(), session_layers=[Path(each).absolute() for each in self.session_layers],
            looks=[absolute(each) or "" for each in self.looks], simulate=absolute(self.simulate),
            emit=absolute(self.emit), plates=plates,
        )  # fmt: skip

    def start_device(self) -> None:
        """Start the device."""
        start_device(self.device, self.threads)
