"""The stage that most tests of the studio show, and sessions whose reports are recorded."""

import threading

import numpy as np

import photonbeams as pb
from photonbeams.studio.session import Picture, Problem, Session, SessionView

STAGE = """#usda 1.0
(
    defaultPrim = "World"
)
def Xform "World"
{
    def Camera "Camera"
    {
        double3 xformOp:translate = (0, 0, 4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def SphereLight "Lamp" (prepend apiSchemas = ["PhotonBeamsLightAPI"])
    {
        float inputs:radius = 0.05
        float inputs:intensity = 20
        int photonbeams:count = 300
        rel photonbeams:look = </World/Look>
    }
    def PhotonBeamsLook "Look"
    {
        color3f photonbeams:along:tint = (1, 0.5, 0.2)
    }
    def Sphere "Ball"
    {
        double radius = 0.3
        double3 xformOp:translate = (0.8, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"])
    {
        color3f photonbeams:scattering = (0.2, 0.2, 0.2)
    }
}
"""


VIEW = SessionView(width=48, height=27, passes=2, denoise=False)
TINT, INTENSITY = "/World/Look.photonbeams:along:tint", "/World/Lamp.inputs:intensity"


class Watched:
    """A session, and a record of what it reports to a listener."""

    def __init__(self, *given, **named):
        self.session, self.told = Session(*given, **{"view": VIEW, **named}), []
        self._came = threading.Condition()
        self.session.listen(self._tell)
        self.session.show()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.session.close()

    def _tell(self, what):
        with self._came:
            self.told.append(what)
            self._came.notify_all()

    def wait(self, version, wanted):
        """Return the first report on a version that `wanted` accepts."""
        with self._came:

            def found():
                return [each for each in self.told if each.version == version and wanted(each)]

            assert self._came.wait_for(found, timeout=120), self.told[-3:]
            return found()[0]

    def finished(self, version=None):
        version = self.session.version if version is None else version
        found = self.wait(version, lambda each: isinstance(each, Problem) or each.is_finished)
        assert isinstance(found, Picture), found
        return found.layers

    def problem(self, version):
        return self.wait(version, lambda each: isinstance(each, Problem)).text


def rendered(stage, *layers, passes=2):
    return pb.Shot.open(stage, session_layers=layers).render(passes=passes, width=48, height=27).layers


def are_equal(some, others):
    return some.keys() == others.keys() and all(np.array_equal(some[name], others[name]) for name in some)
