"""The request of `photonbeams render`: all its flags, in groups, for stages and for Mitsuba scenes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from .flags import (
    Crop,
    CropOption,
    DeviceFlags,
    EyeFlags,
    LayerFlags,
    MessageFlags,
    PassFlags,
    PictureFlags,
    ProgramFlags,
    Resolution,
    SelectionFlags,
    SettingsFlags,
    check_crop,
)  # fmt: skip
from .groups import Flags, option
from .options.fog import FogFlags
from .outputs import Output, PictureExposure, named_layers, parse_outputs, part_outputs

if TYPE_CHECKING:
    from ..images.plates import Holdout, Plate
    from ..usd.settings import RenderProduct


class FileFlags(PictureFlags):
    """The frames, and what is written of them."""

    auto_exposure: bool = option(False, "Choose the exposure by the first frame, and print it.")

    def __post_init__(self) -> None:
        if self.auto_exposure and self.exposure:
            raise typer.BadParameter("--auto-exposure chooses the exposure: expected no --exposure with it")

    @cached_property
    def exposures(self) -> PictureExposure:
        """The exposure of all pictures."""
        return PictureExposure(None if self.auto_exposure else self.exposure)


class ViewFlags(Flags):
    """The camera, and what part of its picture is rendered."""

    camera: str | None = option(
        None, "Path or name of the camera; for a Mitsuba scene, the id of its sensor.", "--camera", "-cam"
    )
    list_cameras: bool = option(False, "List the cameras and stop.")
    res: Resolution = (0, 0)
    res_scale: float = option(
        1.0, "Scale factor for the size.", above=0.0, most=1000.0, expected="more than 0 and no more than 1000"
    )
    crop: CropOption = None
    tile: str | None = option(None, "Render only tile I of N; `photonbeams merge` joins the tiles.", metavar="I/N")

    def __post_init__(self) -> None:
        self._tile()

    def _tile(self) -> tuple[int, int] | None:
        """Return the number of the tile, from 1, and the number of tiles."""
        if self.tile is None:
            return None
        number, _, count = self.tile.partition("/")
        if not (number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
            raise typer.BadParameter(f"--tile is {self.tile}: expected NUMBER/COUNT, as in 1/4")
        return int(number), int(count)

    def crop_of(self, width: int, height: int, own: Crop | None = None) -> Sequence[float] | None:
        """Return the part of the picture to render, in fractions: that of the flags or else the scene's `own`."""
        from ..images.frame import tile_of

        crop, tile = self.crop or own, self._tile()
        return crop if tile is None else tile_of(crop, width, height, tile)


class FarmFlags(Flags):
    """The processes or machines that render, if not this process."""

    workers: int | None = option(
        None, "Render with N processes on this machine.", metavar="N", kind=int, least=1, most=1024
    )
    scheduler: str | None = option(
        None, "Render with the workers of a Dask scheduler at tcp://... or tls://...", metavar="ADDRESS"
    )
    tls_ca: Path | None = option(None, "File with the certificate authority of a tls:// scheduler.", "--tls-ca-file")
    tls_cert: Path | None = option(None, "File with the certificate of this client for it.")
    tls_key: Path | None = option(None, "File with the key of that certificate.")

    def __post_init__(self) -> None:
        if self.files and not (self.scheduler or "").startswith("tls://"):
            raise typer.BadParameter(
                "--tls-ca-file, --tls-cert and --tls-key need a tls:// scheduler: "
                "expected --scheduler tls://ADDRESS, too"
            )
        for path in self.files.values():
            if not Path(path).is_file():
                raise typer.BadParameter(f"{path}: no such file; expected a certificate or its key")
        if self.workers is not None and self.scheduler is not None:
            raise typer.BadParameter("--workers and --scheduler name two farms: expected only one of them")

    @property
    def files(self) -> dict[str, str]:
        """The files for TLS, as `farm.cluster.connected` takes them."""
        tls = {"ca": self.tls_ca, "cert": self.tls_cert, "key": self.tls_key}
        return {name: str(path) for name, path in tls.items() if path is not None}

    @property
    def renders(self) -> bool:
        """Whether a farm renders."""
        return self.workers is not None or self.scheduler is not None


class RenderFogFlags(FogFlags):
    """The fog, and whether it affects only beams."""

    beams_only_fog: bool = option(False, "Let the fog affect only beams: surfaces look as if there were none.")

    def _given(self) -> dict[str, Any]:
        return {**super()._given(), **({"surfaces": False} if self.beams_only_fog else {})}


class StageFlags(Flags):
    """Flags that are only for stages."""

    render_settings: str | None = option(
        None, "RenderSettings prim; flags override it. Default: the one that the stage names.", "--render-settings",
        "-rs", metavar="PATH",
    )  # fmt: skip
    render_pass: str | None = option(
        None, "RenderPass prim: take its render settings and its visibility.", metavar="PATH"
    )
    allow_paths: bool = option(
        False, "Allow render products that the stage names to be written outside the working folder."
    )
    fog: RenderFogFlags
    dome_beams: bool = option(False, "Make beams of dome lights, too, as photonbeams:enabled does.")
    programs: ProgramFlags
    texture_limit: int | None = option(
        None, "Scale down textures wider or higher than this, default: 4096; images on lights may be twice that.",
        metavar="PIXELS", kind=int, least=1, most=65536,
    )  # fmt: skip
    working_space: str | None = option(
        None, "Linear colour space in which light is computed, such as ACEScg; default: that of the render settings, "
        "or linear Rec. 709.", metavar="NAME",
    )  # fmt: skip
    color_space: str | None = option(
        None, "Linear colour space of colours and images that name none; default: linear Rec. 709.", metavar="NAME"
    )
    selection: SelectionFlags
    strict: bool = option(False, "Treat warnings about the stage as errors; otherwise what cannot be read is left out.")


class LookFlags(LayerFlags):
    """What is changed of a scene: looks, light groups, values, layers."""

    look: list[str] | None = option(
        None, "A look written in Python, for all beams or for those of PRIM; may be repeated.",
        metavar="[PRIM=]FILE.py:NAME",
    )  # fmt: skip
    group: list[str] | None = option(
        None, "Light group of an emitter in a Mitsuba scene; may be repeated.", metavar="EMITTER=NAME"
    )
    overrides: list[str] | None = option(
        None, "Override a value of the stage, or NAME=VALUE for a parameter of a Mitsuba scene; may be repeated.",
        "--set", metavar="/prim.attr=value",
    )  # fmt: skip


class RenderEyeFlags(EyeFlags):
    """Whether there are two eyes, and which of them is rendered."""

    view: Literal["left", "right", "both"] | None = option(None, "Which eye to render; default: both, in one file.")

    @property
    def eye(self) -> str | None:
        """The eye that is rendered, None for both."""
        return None if self.view == "both" else self.view


class PlateFlags(Flags):
    """Pictures of another renderer: its depth, at which beams end, and a plate that they are added to."""

    holdout: str | None = option(
        None, "Another renderer's depth: beams end there instead of at the stage's surfaces. A run of # stands for "
        "the frame number, %V for the view.", metavar="FILE",
    )  # fmt: skip
    holdout_channel: str | None = option(
        None, "Channel of the --holdout file; default: the one with a usual name for a depth.", metavar="NAME"
    )
    holdout_depth: Literal["auto", "planar", "distance"] | None = option(
        None, "What the depth measures: along the camera's axis (planar) or from the camera; default: by its name."
    )
    holdout_scale: float | None = option(
        None, "Scene units per unit of the depth; default: 1.", above=0.0, most=1e12, expected=
        "more than 0 and no more than 1e12",
    )  # fmt: skip
    holdout_coverage: str | None = option(
        None, "Channel of the --holdout file that tells how much of a pixel is covered, or none: all of it; default: "
        "the alpha beside the depth.", metavar="NAME",
    )  # fmt: skip
    over: str | None = option(
        None, "A plate to which beams are added: rgba is their sum. Named like --holdout.", metavar="FILE"
    )
    over_fog: bool = option(False, "Let the fog dim the plate, too.")

    def __post_init__(self) -> None:
        for name in ("channel", "depth", "scale", "coverage"):
            if getattr(self, f"holdout_{name}") is not None and not self.holdout:
                raise typer.BadParameter(f"--holdout-{name} needs a holdout: expected --holdout, too")
        if self.over_fog and not self.over:
            raise typer.BadParameter("--over-fog needs a plate: expected --over, too")

    def end(self) -> Holdout | None:
        """Return the holdout, if there is one."""
        from ..images.plates import Holdout

        depth, scale, coverage = (
            self.holdout_depth or "auto",
            self.holdout_scale or 1.0,
            self.holdout_coverage or "auto",
        )
        return Holdout(self.holdout, self.holdout_channel, depth, scale, coverage) if self.holdout else None

    def plate(self) -> Plate | None:
        """Return the plate, if there is one."""
        from ..images.plates import Plate

        return Plate(self.over, self.over_fog) if self.over else None

    def files(self, frame: float, views: Sequence[str]) -> Iterator[Path]:
        """Yield the files of the holdout and the plate of a frame."""
        from ..images.channels import image_paths

        for place in filter(None, (self.holdout, self.over)):
            yield from (path for path, _ in image_paths(place, frame, views))


class ProgressFlags(MessageFlags):
    """What the command prints, and whether it renders at all."""

    progress: Literal["rich", "plain", "openjd", "none"] | None = option(
        None, "How progress is shown; default: rich on a terminal, plain elsewhere."
    )
    dry_run: bool = option(False, "Read and check everything, but render nothing.")
    estimate: bool = option(False, "Tell how long the render would take, and how much memory, instead of rendering.")
    json: bool = option(False, "With --estimate: as JSON, with seconds of a frame, frames, and bytes of memory.")

    def __post_init__(self) -> None:
        if self.json and not self.estimate:
            raise typer.BadParameter("--json is for estimates: expected --estimate, too")

    @property
    def renders(self) -> bool:
        """Whether anything is rendered into files."""
        return not (self.dry_run or self.estimate)


class RenderRequest(Flags):
    """What a user asks to be rendered."""

    scene: Annotated[Path, typer.Argument(help="A .usd, .usda, .usdc or .usdz stage, or a Mitsuba .xml.")]
    output: list[Path] | None = option(
        None, "File to write: .exr (layered) or .png (tone-mapped); may be repeated. A run of # stands for the frame "
        "number. Default: the products of the render settings.", "--output", "-o",
    )  # fmt: skip
    files: FileFlags
    views: ViewFlags
    settings: SettingsFlags
    passes: PassFlags
    farm: FarmFlags
    stage: StageFlags
    looks: LookFlags
    eyes: RenderEyeFlags
    plates: PlateFlags
    device: DeviceFlags
    shown: ProgressFlags

    def __post_init__(self) -> None:
        if self.is_mitsuba:
            for flag in self.stage.given():
                raise typer.BadParameter(f"{flag} is for stages: a Mitsuba scene (.xml) has no use for it")
        elif self.looks.group:
            raise typer.BadParameter(
                "--group is for Mitsuba scenes: for a stage, set photonbeams:lightGroup on its lights"
            )
        check_crop(self.views.crop, overscan=not self.is_mitsuba)
        self._check_parts()

    def _check_parts(self) -> None:
        """Refuse flags that do not go with parts of the picture, or of its passes."""
        given, part, farm = self.settings.values, self.passes.part, self.farm.renders
        if part is not None and farm:
            raise typer.BadParameter(
                "--pass-range is for one process: a farm divides the passes itself, so leave out --pass-range"
            )
        for name in ("time_limit", "error"):
            if name in given and (part is not None or farm):
                raise typer.BadParameter(
                    f"--{name.replace('_', '-')} is for frames that one process renders: "
                    "expected --passes instead for parts and farms"
                )
        if "denoise" in given and self.views.tile is not None:
            raise typer.BadParameter(
                "--denoise would make the edges of tiles visible: expected --pass-range instead of --tile"
            )
        if "keep_noisy" in given and "denoise" not in given:
            raise typer.BadParameter("--keep-noisy keeps the layers before denoising: expected --denoise, too")

    @property
    def strict(self) -> bool | Literal["missing"]:
        """Which warnings about the stage are errors."""
        return self.stage.strict or ("missing" if self.files.fail_missing else False)

    @property
    def is_mitsuba(self) -> bool:
        """Whether the scene is one of Mitsuba's, rather than a stage."""
        return self.scene.suffix.lower() == ".xml"

    @cached_property
    def outputs(self) -> Sequence[Output]:
        """The files that flags name, not yet numbered."""
        if self.passes.part is not None:
            return part_outputs(self.output or ())
        files = self.files
        return parse_outputs(self.output or (), files.picture or (), files.deep, single_part=files.single_part)

    @property
    def programs(self) -> Iterator[Path]:
        """The files of Python that flags name, as PRIM=FILE.py:NAME."""
        named = *(self.looks.look or ()), self.stage.programs.simulate, self.stage.programs.emit
        for text in filter(None, named):
            yield Path(text.rpartition("=")[2].rpartition(":")[0])

    def wants(self, layer: str, products: Iterable[RenderProduct] = ()) -> bool:
        """Return whether the flags ask for a layer or, if they name no files, the render products do."""
        given = named_layers(self.files.layers) if self.files.layers is not None else []
        named = () if self.outputs else (each.variables for each in products)
        return layer in set(given) | {name for each in named for name in each}

    def wants_deep(self, products: Iterable[RenderProduct] = ()) -> bool:
        """Return whether the flags ask for a deep file or, if they name no files, a render product does."""
        return self.files.deep is not None or (not self.outputs and any(each.deep for each in products))

    def anywhere(self) -> RenderRequest:
        """Return the request with absolute paths, for a process that runs in another folder."""

        def absolute(text: str | None) -> str | None:
            """Return FILE or PRIM=FILE.py:NAME with an absolute path."""
            if text is None:
                return None
            prim, equals, file = text.rpartition("=")
            return f"{prim}{equals}{Path(file).absolute()}"

        stage, looks, plates = self.stage, self.looks, self.plates
        programs = replace(
            stage.programs, simulate=absolute(stage.programs.simulate), emit=absolute(stage.programs.emit)
        )
        return replace(
            self, scene=self.scene.absolute(), stage=replace(stage, programs=programs),
            looks=replace(
                looks, look=[absolute(each) or "" for each in looks.look or ()],
                session_layer=[Path(each).absolute() for each in looks.session_layer or ()],
            ),
            plates=replace(plates, holdout=absolute(plates.holdout), over=absolute(plates.over)),
        )  # fmt: skip
