"""Overscan of pictures so wide that some rays stand for others: the picture keeps its bits."""

import numpy as np

import photonbeams as pb

BOX = pb.scene.Mesh(
    "/Box",
    points=np.array([[-0.4, -1, -1], [0.3, -1, -1.5], [0.3, 1, -1.5], [-0.4, 1, -1]], dtype=np.float32),
    faces=np.array([[0, 1, 2], [0, 2, 3]]),
)
LAMP = pb.scene.SphereLight("/Lamp", 50.0, center=(0, 2, 0.3), axis=(0, -1, 0), shaping=pb.scene.Shaping(cone_angle=50))


def test_rays_that_stand_for_others_do_not_depend_on_overscan():
    """Beams are also gathered along more rays of pixels with an edge, inside the picture and beyond it."""
    content = pb.scene.Scene(meshes=(BOX,), lights=LAMP, media=pb.Medium(scattering=0.1))
    shot = pb.Shot(content, pb.scene.Camera.look_at(origin=(0, 0.2, 3), target=(0, 0.2, 0), aspect=400 / 16))
    given = {"passes": 1, "beams": 256, "width": 400, "height": 16, "surface_samples": 2, "guiding": False}
    whole = shot.render(**given).layers
    exact = shot.render(**given, gather_error=0.0).layers
    assert not np.array_equal(whole["beams"], exact["beams"])
    wide = shot.render(**given, crop=(-0.013, -0.4, 1.02, 1.6)).layers
    for name, pixels in whole.items():
        assert np.array_equal(wide[name][7:23, 6:406], pixels), name
    assert np.isfinite(wide["beams"]).all()
    for side in (np.s_[:7], np.s_[23:], np.s_[:, :6], np.s_[:, 406:]):
        assert wide["beams"][side].mean() > 0.2 * whole["beams"].mean()
