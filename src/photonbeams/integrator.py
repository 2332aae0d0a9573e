"""The Mitsuba plug-in `photon_beams`, an integrator that renders any Mitsuba 3 scene by photon beams.

`import photonbeams` registers it with Mitsuba, whether Mitsuba is imported before or after, for each variant that is
set.
"""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any

from .render.settings import Settings, parameters
from .setting import Setting

if TYPE_CHECKING:
    from types import ModuleType

    from drjit import ADMode

    from .render.passes import RunOptions
    from .runtime.device import Bool, UInt32
    from .runtime.mitsuba_types import ImageBlock, MiFilm, MiScene, MiSensor, Properties, RayDifferential, Sampler
    from .scene.checks import Array

NAME = "photon_beams"

_NO_DERIVATIVES = (
    f"{NAME}: a render has no derivatives by the scene's parameters: expected photonbeams.estimate, "
    "which has derivatives by beams, fog and looks"
)


class NotOfferedError(NotImplementedError):
    """Something that Mitsuba's own integrators can do and this one cannot; the text is one sentence for the user."""


#: The one parameter that is no setting.
LAYERS = Setting(
    name="layers", kind=bool, default=False, help="Add the layers `beams` and `surface`, whose sum is the image."
)

VARIANTS = ("llvm_ad_rgb", "llvm_ad_mono", "cuda_ad_rgb", "cuda_ad_mono")

_MANUAL = r"""
.. _integrator-photon_beams:

Photon beams (:monosp:`photon_beams`)
-------------------------------------

.. pluginparameters::

{parameters}
Numbers with the default 0 are chosen by the integrator. With an `error`, there are at most as many passes as samples
per pixel; otherwise, there are exactly as many.

This integrator traces light into photon beams (Jarosz et al. 2011) and gathers them along camera rays, with the
estimators of "Gaussian Quadrature for Photon Beams in Tangled" (Johnson et al. 2011). Radii shrink from pass to pass
("Progressive Photon Beams", Jarosz et al. 2011), so that the image converges to that of :monosp:`volpath`, volumetric
caustics included. Camera rays see beams through glass and in mirrors. Surfaces are lit directly by emitters, by
paths from the camera, and by photons, which carry the caustics.

Media may be inside shapes or around them, and nested. A medium that only an emitter or the sensor names fills the
space. Where the sensor or an emitter names no medium, its medium is found from the shapes around it.

.. tabs::

    .. code-tab:: xml

        <integrator type="photon_beams">
            <integer name="paths" value="16384"/>
        </integrator>

    .. code-tab:: python

        'type': 'photon_beams',
        'paths': 16384
"""


def announce(_: object) -> None:
    """Register the plug-in for the variant that Mitsuba has, and for each that is set later."""
    mitsuba = sys.modules["mitsuba"]  # looked up there: Mitsuba replaces its module while it is imported
    if mitsuba.variant() is not None:
        _register(mitsuba, mitsuba.variant())
    mitsuba.detail.add_variant_callback(lambda _, variant: _register(mitsuba, variant))


def _register(mitsuba: ModuleType, variant: str) -> None:
    from .runtime import device

    if variant.startswith("llvm"):
        device.check_library()  # now: a kernel of Mitsuba's own would end the process
    made = cache(partial(_integrator, mitsuba, variant))

    def make(properties: Properties) -> Any:
        if variant not in VARIANTS:
            raise NotOfferedError(
                f"{NAME}: the variant is {variant}: expected {', '.join(VARIANTS[:-1])} or {VARIANTS[-1]}"
            )
        return made()(properties)

    mitsuba.register_integrator(NAME, make)


def _manual() -> str:
    """Return the plug-in's page of a manual, in the form of those of Mitsuba's own plug-ins."""
    rows = []
    for each in [*(found for _, found in parameters()), LAYERS]:
        default = "0" if each.default is None else _shown(each.default).lower()
        meaning = textwrap.fill(f"{each.help} (Default: {default})", 115, subsequent_indent="     ")
        rows.append(f" * - {each.name}\n   - |{each.type_name}|\n   - {meaning}\n")
    return _MANUAL.replace("{parameters}", "\n".join(rows))


def _settings(properties: Properties) -> Settings:
    """Return the plug-in's parameters as settings. Mitsuba reports parameters that are never read as unknown."""
    from .quadrature import gauss_legendre

    given = {name: _value(properties, each) for name, each in parameters()}
    return Settings(**{**given, "rule": gauss_legendre(given["rule"]), "short": given["short"] == "short"})


def _value(properties: Any, parameter: Setting) -> Any:
    """Return a parameter, or None for a 0 that leaves the choice to the integrator.

    ValueError is raised for a value whose type is not that of the default, which Mitsuba does not check.
    """
    name, default = parameter.name, 0.0 if parameter.default is None else parameter.default
    value, kind = properties.get(name, default), type(default)
    exact = type(value) is kind  # not isinstance, for a bool is an int
    if not exact and kind in (int, float) and type(value) in (int, float):
        exact = kind is float or float(value).is_integer()
    if not exact:
        expected = {bool: "true or false", int: "a whole number", float: "a number", str: "a string"}[kind]
        raise ValueError(f"{NAME}: {name} is {_shown(value)}: expected {expected}")
    value = kind(value)
    return None if parameter.default is None and not value else parameter.checked(value, name)


def _shown(value: object) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value)


def _integrator(mi: Any, variant: str) -> type:
    """Return the plug-in's class for a variant: Mitsuba has another base class in each."""
    from .runtime import device

    device.select("cuda" if variant.startswith("cuda") else "cpu")

    class PhotonBeams(mi.ad.integrators.common.ADIntegrator):  # type: ignore[misc]
        __doc__ = _manual()

        def __init__(self, properties: Properties) -> None:
            settings, layers = _settings(properties), _value(properties, LAYERS)
            super().__init__(properties)
            self.settings, self._layers = settings, layers
            self._warned: set[str] = set()
            self._last = _LastRender()

        def aov_names(self) -> list[str]:
            """Return the names of the layers' channels."""
            names = [f"{layer}.{channel}" for layer in ("beams", "surface") for channel in "RGB"]
            return names if self._layers else []

        def render(
            self, scene: MiScene, sensor: MiSensor | int = 0, seed: UInt32 | int = 0, spp: int = 0,
            develop: bool = True, evaluate: bool = True,
        ) -> Any:  # fmt: skip
            """Render the scene from a sensor, or from the sensor of that index; `spp` is the number of passes."""
            device.check_recording()  # first, since garbage that is collected meanwhile would end the process, too
            import drjit as dr

            from .render.films.denoising import check_denoiser
            from .scene import SceneError

            count = len(scene.sensors())
            if isinstance(sensor, int) and not 0 <= sensor < count:
                raise SceneError(f"{NAME}: sensor is {sensor}: expected a sensor of the scene, which has {count}")
            sensor = scene.sensors()[sensor] if isinstance(sensor, int) else sensor
            passes = spp or int(sensor.sampler().sample_count())
            settings = replace(self.settings, passes=passes, seed=int(_number(seed)))
            if settings.denoise:
                check_denoiser()
            with dr.suspend_grad():
                picture = self._rendered(scene, sensor, settings)
                film = sensor.film()
                film.prepare(self.aov_names())
                film.put_block(_block(mi, film, picture, self._layers))
                if not develop:
                    return mi.TensorXf()
                image = film.develop()
                if evaluate:
                    dr.eval(image)
                return image

        def _rendered(self, scene: MiScene, sensor: MiSensor, settings: Settings) -> dict[str, Array]:
            """Return the layers, with what the pilots found in the last render if the scene has not changed since."""
            from .render.films.denoising import denoised
            from .render.pilots.pilot import Findings
            from .render.scene_frame import Extras, render
            from .world.parameters import Parameters

            last = self._last
            if last.parameters != Parameters(scene, sensor):
                # Kernels depend on how many plug-ins there are, so those that the last findings hold go first.
                last.parameters, last.findings = None, Findings()
            with _bar(settings) as run:
                frame = render(
                    scene,
                    sensor,
                    settings,
                    run,
                    warned=self._warned,
                    extras=Extras(depth=False, findings=last.findings),
                )
            # Only now: a render turns parameters that were constants into variables.
            last.parameters, last.findings = Parameters(scene, sensor), frame.findings
            layers = frame.layers()
            return denoised(layers, frame.sums().views[0], {}) if settings.denoise else layers

        def sample(
            self, mode: ADMode, scene: MiScene, sampler: Sampler, ray: RayDifferential, *_: object,
            active: Bool | bool = True, **__: object,
        ) -> Any:  # fmt: skip
            """Return the radiance along rays, whether they met something, and the layers' channels.

            It is called by integrators around this one, such as `aov`, and expects all rays in one call. Each call
            traces light anew, with a seed from the sampler, in as many passes as that has samples per pixel.
            """
            device.check_recording()
            import drjit as dr

            from .render.scene_rays import radiance

            if mode != dr.ADMode.Primal:
                raise NotOfferedError(_NO_DERIVATIVES)
            if self.settings.denoise or self.settings.error:
                raise NotOfferedError(
                    f"{NAME}: denoise and error need the whole picture: expected neither within another integrator"
                )
            if dr.flag(dr.JitFlag.SymbolicScope):
                text = "sample was called within a recorded loop: expected one call with all rays"
                raise NotOfferedError(f"{NAME}: {text}")
            with dr.suspend_grad():
                seed = int(_number(sampler.next_1d().numpy()) * 2**24)
                settings = replace(self.settings, passes=int(sampler.sample_count()), seed=seed)
                light = radiance(scene, ray, active, settings, self._warned)
                layers = [channel for layer in light[:2] for channel in layer] if self._layers else []
                total = light.beams + light.surface
                spectrum = mi.Spectrum(total if len(mi.Spectrum()) == 3 else total.x)  # or of one channel
                return spectrum, light.alpha > 0, layers, None

        def render_forward(self, *_: object, **__: object) -> Any:
            """Raise NotOfferedError: `photonbeams.estimate` has derivatives, by beams, fog and looks."""
            raise NotOfferedError(_NO_DERIVATIVES)

        render_backward = render_forward

        def to_string(self) -> str:
            return f"PhotonBeams[{self.settings}]"

    return PhotonBeams


class _LastRender:
    """The parameters of the scene, and what the pilots found, of a render; Dr.Jit looks into a tuple of them."""

    def __init__(self) -> None:
        self.parameters: Any = None
        self.findings: Any = None


@contextmanager
def _bar(settings: Settings) -> Iterator[RunOptions]:
    """Yield options of a render that draw its progress on a terminal, and do nothing elsewhere."""
    from .render.passes import PLAIN_RUN, RunOptions
    from .runtime.bars import drawn, terminal

    console = terminal()
    if console is None:
        yield PLAIN_RUN
        return
    total = None if settings.error else settings.passes
    with drawn(console) as update:
        yield RunOptions(progress=lambda done, _: update(done, total, f"{NAME}, passes"))


def _number(values: Any) -> Any:
    """Return the first of some numbers, or the only one."""
    import numpy as np

    return np.ravel(values)[0]


def _block(mi: ModuleType, film: MiFilm, layers: Mapping[str, Array], with_layers: bool) -> ImageBlock:
    """Return the picture as an image block: colours, alpha if the film has it, weight, and the layers if wanted."""
    import numpy as np

    rgba = layers["rgba"]
    weight = np.ones_like(rgba[..., :1])
    alpha = mi.has_flag(film.flags(), mi.FilmFlags.Alpha)
    parts = [rgba if alpha else rgba[..., :3], weight]
    if with_layers:
        parts += [layers["beams"], layers["surface"]]
    tensor = mi.TensorXf(np.ascontiguousarray(np.concatenate(parts, axis=2), dtype=np.float32))
    return mi.ImageBlock(tensor, offset=film.crop_offset())
