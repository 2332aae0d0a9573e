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


def test_a_lamp_that_overscan_alone_sees_before_its_portal_is_told(caplog):
    """A lamp shines down through a hole in a roof, and only overscan sees what is above the roof."""
    corners = np.array([[x, 1, z] for x, z in ((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2))])
    hole = pb.scene.Mesh("/Hole", corners, np.array([[0, 1, 2], [0, 2, 3]]))
    edges = [(-9, -0.2, -9, 3), (0.2, 9, -9, 3), (-0.2, 0.2, -9, -0.2), (-0.2, 0.2, 0.2, 3)]  # x0, x1, z0, z1
    points = [[x, 1, z] for x0, x1, z0, z1 in edges for x, z in ((x0, z0), (x1, z0), (x1, z1), (x0, z1))]
    points += [[-9, 1, -9], [9, 1, -9], [9, -9, -9], [-9, -9, -9]]  # a wall behind
    points += [[-1, -0.3, 3], [1, -0.3, 3], [1, 0.3, 3], [-1, 0.3, 3]]  # a board between the camera and the hole
    faces = [[4 * k + i for i in face] for k in range(6) for face in ((0, 1, 2), (0, 2, 3))]
    roof = pb.scene.Mesh("/Roof", np.array(points, dtype=np.float64), np.array(faces))
    lamp = pb.scene.SphereLight("/Lamp", 50.0, center=(0, 2, 0), portal=hole)
    content = pb.scene.Scene(meshes=(roof,), lights=lamp, media=pb.Medium(scattering=0.1))
    shot = pb.Shot(content, pb.scene.Camera.look_at(origin=(0, -1, 6), target=(0, -1, 0), fov=20))
    given = {"passes": 1, "beams": 16, "width": 16}
    whole = shot.render(**given).layers["beams"]
    assert not caplog.messages
    wide = shot.render(**given, crop=(0, -5, 1, 1)).layers["beams"]
    assert np.array_equal(wide[45:], whole)
    assert caplog.messages == ["/Lamp is seen before its portal in overscan alone, where its beams are left out"]
