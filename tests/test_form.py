"""Measures of form against closed forms."""

from __future__ import annotations

import math

import pytest

from lithoform.descriptors import form


def test_a_sphere_is_one_in_every_sphericity():
    d = 0.7
    volume, area = math.pi * d**3 / 6, math.pi * d**2
    assert form.true_sphericity(volume, area) == pytest.approx(1.0, abs=1e-14)
    assert form.equivalent_diameter(volume) == pytest.approx(d, rel=1e-14)
    assert form.boxiness(volume, d, d, d) == pytest.approx(math.pi / 6, rel=1e-14)
    assert form.krumbein_sphericity(d, d, d) == 1.0
    assert form.maximum_projection_sphericity(d, d, d) == 1.0
    assert form.sneed_folk_form(d, d, d) == 0.5


def test_a_cube_has_wadells_sphericity():
    assert form.true_sphericity(8.0, 24.0) == pytest.approx((math.pi / 6) ** (1 / 3), rel=1e-14)
    assert form.boxiness(8.0, 2.0, 2.0, 2.0) == 1.0


def test_krumbeins_intercept_sphericity_is_that_of_the_ellipsoid_in_its_ball():
    a, b, c = 1.0, 2.0, 3.0
    ellipsoid, ball = math.pi / 6 * a * b * c, math.pi / 6 * c**3
    assert form.krumbein_sphericity(c, b, a) == pytest.approx((ellipsoid / ball) ** (1 / 3), rel=1e-14)


def test_sneed_and_folk_tell_disc_from_rod():
    assert form.sneed_folk_form(3.0, 3.0, 1.0) == 0.0
    assert form.sneed_folk_form(3.0, 1.0, 1.0) == 1.0
    # A disc settles flat: its projected area is large for its volume.
    assert form.maximum_projection_sphericity(3.0, 3.0, 1.0) == pytest.approx((1 / 9) ** (1 / 3))
    assert form.maximum_projection_sphericity(3.0, 1.0, 1.0) == pytest.approx((1 / 3) ** (1 / 3))


@pytest.mark.parametrize(
    ("dimensions", "name"),
    [
        ((1.0, 0.9, 0.8), "cube"),
        ((1.0, 0.9, 0.5), "plate"),
        ((1.0, 0.5, 0.45), "column"),
        ((1.0, 0.5, 0.2), "blade"),
        ((3.0, 2.0, 2.0), "cube"),  # on the limit itself: not elongated
    ],
)
def test_zinggs_classes(dimensions, name):
    assert form.zingg_class(*dimensions) == name
    assert form.elongation(*dimensions[:2]) == dimensions[1] / dimensions[0]
    assert form.flatness(*dimensions[1:]) == dimensions[2] / dimensions[1]
