"""The Mitsuba plug-in `photon_beams`, an integrator that renders any Mitsuba 3 scene by photon beams.

`import photonbeams` registers it with Mitsuba, whether Mitsuba is imported before or after, for each variant that is
set.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .render.passes import RunOptions
    from .render.settings import Settings

NAME = "photon_beams"

_NO_DERIVATIVES = (
    f"{NAME}: a render has no derivatives by the scene's parameters: expected photonbeams.estimate, "
    "which has derivatives by beams, fog and looks"
)


class NotOfferedError(NotImplementedError):
    """Something that Mitsuba's own integrators can do and this one cannot; the text is one sentence for the user."""


VARIANTS = ("llvm_ad_rgb", "llvm_ad_mono", "cuda_ad_rgb", "cuda_ad_mono")

_DOCUMENTATION = r"""
.. _integrator-photon_beams:

Photon beams (:monosp:`photon_beams`)
-------------------------------------

.. pluginparameters::

 * - max_depth
   - |int|
   - Longest path in the image, in edges; -1 is no limit. 1 shows only emitters that the camera sees directly, 2 adds
     light that is scattered once, and so on. (Default: -1)

 * - rr_depth
   - |int|
   - Bounces after which paths may end by Russian roulette. (Default: 5)

 * - hide_emitters
   - |bool|
   - Hide directly visible emitters. (Default: no, i.e. |false|)

 * - paths
   - |int|
   - Light paths in each pass. There are as many passes as samples per pixel; in each pass, a pixel has one sample of
     beams and up to 16 samples of surfaces. (Default: 16384)

 * - radius
   - |float|
   - Radius of all beams in the first pass, in scene units; 0 takes the radii from photon differentials. (Default: 0)

 * - min_radius, max_radius
   - |float|
   - Bounds of the radii from photon differentials, in scene units. With 0, they are 0.0001 and 0.05 of the radius of
     the medium, and at most a quarter of a mean free path; for photons, 0.0001 and 0.05 of the radius of the scene.
     (Default: 0)

 * - overlap
   - |float|
   - Width of a beam, in spacings of its neighbours. (Default: 2.2)

 * - alpha
   - |float|
   - How fast radii shrink from pass to pass: above 0, and at most 1, which keeps them as they are. (Default: 0.7)

 * - guiding
   - |bool|
   - Run a pilot pass that learns which light the camera sees, and send more light paths there.
     (Default: yes, i.e. |true|)

 * - method
   - |string|
   - How the light of emitters is found: "beams" traces light paths from them; "paths" traces paths from the camera,
     except for emitters that have a look, a portal, a gobo or settings of their beams; "auto" runs a pilot and takes
     whichever has less noise. (Default: "auto")

 * - beams
   - |string|
   - "long" beams reach to the next surface, "short" ones end where their light is scattered. (Default: "long")

 * - estimator
   - |string|
   - "billboard" (beam x beam 1D), "frustum" (beam x beam 2D, by quadrature), or "auto", which blends the two.
     (Default: "auto")

 * - order
   - |int|
   - Number of points of the Gauss-Legendre quadrature. (Default: 6)

 * - gather_error
   - |float|
   - Approximate relative error that is allowed where fewer rays than pixels see the beams; 0 is exact.
     (Default: 0.002)

 * - error
   - |float|
   - Relative error at which the render stops: half of the light is in pixels with a smaller error. There are at most as
     many passes as samples per pixel; with 0, there are exactly as many. (Default: 0)

 * - denoise
   - |bool|
   - Denoise surfaces, and beams where they need it, by Open Image Denoise. (Default: no, i.e. |false|)

 * - layers
   - |bool|
   - Add the layers `beams` and `surface`, whose sum is the image. (Default: no, i.e. |false|)

This integrator traces light into photon beams (Jarosz et al. 2011) and gathers them along camera rays, with the
estimators of "Gaussian Quadrature for Photon Beams in Tangled" (Johnson et al. 2011). Radii shrink from pass to pass
("Progressive Photon Beams", Jarosz et al. 2011), so that the image converges to that of :monosp:`volpath`, volumetric
caustics included. Camera rays see beams through glass and in mirrors. Surfaces are lit directly by emitters, and by
photons, which carry the light of all other paths.

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


def announce(_: Any) -> None:
    """Register the plug-in for the variant that Mitsuba has, and for each that is set later."""
    mitsuba = sys.modules["mitsuba"]  # looked up there: Mitsuba replaces its module while it is imported
    mitsuba.detail.add_variant_callback(lambda _, variant: _register(mitsuba, variant))
    if mitsuba.variant() is not None:
        _register(mitsuba, mitsuba.variant())


def _register(mitsuba: Any, variant: str) -> None:
    made = cache(partial(_integrator, mitsuba, variant))

    def make(properties: Any) -> Any:
        if variant not in VARIANTS:
            raise NotOfferedError(
                f"{NAME}: the variant is {variant}: expected {', '.join(VARIANTS[:-1])} or {VARIANTS[-1]}"
            )
        return made()(properties)

    mitsuba.register_integrator(NAME, make)


def _settings(properties: Any) -> Any:
    """Return the plug-in's parameters as settings. Mitsuba reports those that nothing here reads as unknown."""
    from .quadrature import MOST_POINTS, gauss_legendre
    from .render.settings import DEFAULT_PATHS, DEFAULTS, Settings
    from .scene import MOST_BEAMS

    given: dict[str, Any] = {
        name: _value(properties, name, getattr(DEFAULTS, name))
        for name in (
            "rr_depth",
            "hide_emitters",
            "overlap",
            "alpha",
            "estimator",
            "method",
            "gather_error",
            "denoise",
        )
    }
    paths = _value(properties, "paths", DEFAULT_PATHS)
    if not 1 <= paths <= MOST_BEAMS:  # `Settings` would call them beams
        raise ValueError(f"paths is {paths}: expected 1 to {MOST_BEAMS}")
    kind = _value(properties, "beams", "long")
    if kind not in ("long", "short"):
        raise ValueError(f'{NAME}: beams is "{kind}": expected "long" or "short"')
    numbers: dict[str, Any] = {
        name: _value(properties, name, 0.0) or None for name in ("radius", "min_radius", "max_radius", "error")
    }
    order = _value(properties, "order", 6)
    if not 1 <= order <= MOST_POINTS:
        raise ValueError(f"{NAME}: order is {order}: expected 1 to {MOST_POINTS} points")
    return Settings(
        **given, **numbers, beams=paths, max_depth=_value(properties, "max_depth", -1), short=kind == "short",
        guiding=_value(properties, "guiding", True), rule=gauss_legendre(order),
    )  # fmt: skip


def _value(properties: Any, name: str, default: Any) -> Any:
    """Return a parameter; raise ValueError where its type is not that of its default, which Mitsuba does not check."""
    value, kind = properties.get(name, default), type(default)
    exact = type(value) is kind  # not isinstance, for a bool is an int
    if not exact and kind in (int, float) and type(value) in (int, float):
        exact = kind is float or float(value).is_integer()
    if not exact:
        expected = {bool: "true or false", int: "a whole number", float: "a number", str: "a string"}[kind]
        raise ValueError(f"{NAME}: {name} is {_shown(value)}: expected {expected}")
    return kind(value)


def _shown(value: Any) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value)


def _integrator(mi: Any, variant: str) -> type:
    """Return the plug-in's class for a variant: Mitsuba has another base class in each."""
    from .runtime import device

    device.select("cuda" if variant.startswith("cuda") else "cpu")

    class PhotonBeams(mi.ad.integrators.common.ADIntegrator):  # type: ignore[misc]
        __doc__ = _DOCUMENTATION

        def __init__(self, properties: Any) -> None:
            renderer = _Renderer(mi, _settings(properties), _value(properties, "layers", False))
            super().__init__(properties)
            self.settings, self._renderer = renderer.settings, renderer

        def aov_names(self) -> list[str]:
            """Return the names of the layers' channels."""
            return self._renderer.channels

        def render(
            self, scene: Any, sensor: Any = 0, seed: Any = 0, spp: int = 0, develop: bool = True, evaluate: bool = True
        ) -> Any:
            """Render the scene; `spp` is the number of passes."""
            return self._renderer.render(scene, sensor, seed, spp, develop=develop, evaluate=evaluate)

        def sample(self, mode: Any, scene: Any, sampler: Any, ray: Any, *_: Any, active: Any = True, **__: Any) -> Any:
            """Return the radiance along rays, for integrators around this one, such as `aov`.

            All rays are expected in one call. Each call traces light anew, with a seed from the sampler, in as many
            passes as the sampler has samples per pixel.
            """
            return self._renderer.sample(mode, scene, sampler, ray, active)

        def render_forward(self, *_: Any, **__: Any) -> Any:
            """Raise NotOfferedError, as `render_backward` does."""
            return self.render_backward()

        def render_backward(self, *_: Any, **__: Any) -> Any:
            """Raise NotOfferedError: `photonbeams.estimate` has derivatives, by beams, fog and looks."""
            raise NotOfferedError(_NO_DERIVATIVES)

        def to_string(self) -> str:
            return f"PhotonBeams[{self.settings}]"

    return PhotonBeams


class _Renderer:
    """The plug-in without Mitsuba's base class; `layers` says whether the picture has the layers as channels."""

    def __init__(self, mi: Any, settings: Settings, layers: bool) -> None:
        self._mi, self.settings, self._layers = mi, settings, layers
        self._warned: set[str] = set()
        self._last: tuple[Any, Any] = (None, None)  # parameters of the scene, and the pilots' findings, of a render

    @property
    def channels(self) -> list[str]:
        """The names of the layers' channels."""
        return [f"{layer}.{channel}" for layer in ("beams", "surface") for channel in "RGB"] if self._layers else []

    def render(self, scene: Any, sensor: Any, seed: Any, spp: int, *, develop: bool, evaluate: bool) -> Any:
        """Return the picture of a sensor, or of the sensor of that index."""
        from .runtime import device

        device.check_recording()  # first, since garbage that is collected meanwhile would end the process, too
        import drjit as dr

        from .render.denoising import check_denoiser

        sensor = scene.sensors()[sensor] if isinstance(sensor, int) else sensor
        settings = replace(self.settings, passes=spp or int(sensor.sampler().sample_count()), seed=_number(seed))
        if settings.denoise:
            check_denoiser()
        with dr.suspend_grad():
            picture = self._rendered(scene, sensor, settings)
            film = sensor.film()
            film.prepare(self.channels)
            film.put_block(_block(self._mi, film, picture, self._layers))
            if not develop:
                return self._mi.TensorXf()
            image = film.develop()
            if evaluate:
                dr.eval(image)
            return image

    def _rendered(self, scene: Any, sensor: Any, settings: Settings) -> dict[str, Any]:
        """Return the layers, with what the pilots found in the last render if neither scene nor sensor has changed."""
        from .render.denoising import denoised
        from .render.scene_frame import Extras, render
        from .render.scene_light import Findings
        from .world.parameters import Parameters

        parameters, findings = self._last
        if parameters != Parameters(scene, sensor):
            findings = Findings()
        with _bar(settings) as run:
            frame = render(
                scene, sensor, settings, run, warned=self._warned, extras=Extras(depth=False, findings=findings)
            )
        # Only now: a render turns parameters that were constants into variables.
        self._last = Parameters(scene, sensor), findings
        layers = frame.layers()
        return denoised(layers, frame.sums().views[0], {}) if settings.denoise else layers

    def sample(self, mode: Any, scene: Any, sampler: Any, ray: Any, active: Any) -> Any:
        """Return the radiance along rays, whether they met something, and the layers' channels."""
        from .runtime import device

        device.check_recording()
        import drjit as dr
        import numpy as np

        from .render.scene_rays import radiance

        if mode != dr.ADMode.Primal:
            raise NotOfferedError(_NO_DERIVATIVES)
        if self.settings.denoise or self.settings.error:
            raise NotOfferedError(
                f"{NAME}: denoise and error need the whole picture: expected neither within another integrator"
            )
        if dr.flag(dr.JitFlag.SymbolicScope):
            raise NotOfferedError(f"{NAME}: sample was called within a recorded loop: expected one call with all rays")
        with dr.suspend_grad():
            seed = int(np.ravel(sampler.next_1d().numpy())[0] * 2**24)
            settings = replace(self.settings, passes=int(sampler.sample_count()), seed=seed)
            found = radiance(scene, ray, active, settings, self._warned)
            layers = [channel for layer in found[:2] for channel in layer] if self._layers else []
            return _spectrum(self._mi, found.beams + found.surface), found.alpha > 0, layers, None


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


def _number(seed: Any) -> int:
    import numpy as np

    return int(np.ravel(seed)[0])


def _spectrum(mi: Any, radiance: Any) -> Any:
    """Return a radiance as Mitsuba's spectrum, which has one channel in monochrome variants."""
    return mi.Spectrum(radiance) if len(mi.Spectrum()) == 3 else mi.Spectrum(radiance.x)


def _block(mi: Any, film: Any, layers: dict[str, Any], with_layers: bool) -> Any:
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
